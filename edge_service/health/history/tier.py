"""Rows of one resolution, and the coarser ones that stand in where it has none."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Protocol

import numpy as np

from .rows import Rows, in_order, joined, no_rows


@dataclass(frozen=True, slots=True)
class Resolution:
    """One tier's step and files.

    Attributes:
        name: its folder.
        step_s: length of a row, s; 0: every estimate by itself.
        file_name: strftime format of its files' names; what it leaves out shares a file.
        file_span: the longest time in one file.
    """

    name: str
    step_s: float
    file_name: str
    file_span: timedelta

    def start_s(self, name: str) -> float:
        """UNIX time at which a file begins, s, by its name without suffix. Raises ValueError."""
        return datetime.strptime(name, self.file_name).replace(tzinfo=UTC).timestamp()


RAW = Resolution("raw", 0.0, "%Y-%m-%dT%H", timedelta(hours=1))
MINUTE = Resolution("minute", 60.0, "%Y-%m-%d", timedelta(days=1))
HOUR = Resolution("hour", 3600.0, "%Y", timedelta(days=366))


class Tier(Protocol):
    """A table of rows by time."""

    resolution: Resolution

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time."""
        ...

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows`, all inside [start_s, end_s), take the place of what is there."""
        ...


class MemoryTier:
    """The newest `capacity` rows, in memory."""

    def __init__(self, resolution: Resolution, capacity: int) -> None:
        self.resolution = resolution
        self._capacity = capacity
        self._rows = no_rows()

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time."""
        return self._rows.between(start_s, end_s)

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows` take the place of what is in [start_s, end_s); the oldest make room."""
        kept = in_order(joined([outside(self._rows, start_s, end_s), rows]))
        excess = len(kept) - self._capacity
        self._rows = kept.take(np.arange(excess, len(kept))) if excess > 0 else kept


def outside(rows: Rows, start_s: float, end_s: float) -> Rows:
    """Rows that begin before or after [start_s, end_s)."""
    return rows.take((rows.time_s < start_s) | (rows.time_s >= end_s))


def filled(start_s: float, end_s: float, tiers: Sequence[Tier]) -> Rows:
    """Rows of [start_s, end_s) of the first tier, with those of the next ones in its holes.

    Holes are where finer rows have made room, or were in a damaged file. Raises OSError.
    """
    finest, *coarser = tiers
    rows = finest.read(start_s, end_s)
    for tier in coarser:
        rows = in_order(joined([_missing(tier, start_s, end_s, rows), rows]))
    return rows


def _missing(tier: Tier, start_s: float, end_s: float, finer: Rows) -> Rows:
    """Whole rows of a tier within whose time no finer row begins."""
    step_s = tier.resolution.step_s
    rows = tier.read(start_s, end_s - step_s + 1e-6)
    following = np.append(finer.time_s, np.inf)[np.searchsorted(finer.time_s, rows.time_s)]
    return rows.take(following >= rows.time_s + step_s)
