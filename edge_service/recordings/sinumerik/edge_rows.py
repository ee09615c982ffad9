"""Rows of Industrial Edge's `HFData`, named by a `Header`, as numbers.

`SignalListHFData` lists a row's signals (`Name`, `Type`, `Axis`, `Address`), `CycleTimeMs` is the
length of a cycle. Layout: CaptureDataParser of max-scw, and its example.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...messages.samples import Booleans, Floats
from ..block import Text
from .controller_signals import EDGE_CYCLE
from .edge_context import EdgeContext

HEADER, PAYLOAD, SAMPLES, EVENT = "Header", "Payload", "HFData", "HFBlockEvent"
MOST_SIGNALS = 4096
SHORTEST_S, LONGEST_S = 1e-5, 10.0


class EdgeRows:
    """The signals of one `Header`. A row without a number for each is set aside and counted.

    Args:
        header: as JSON gives it.
        first: the first rows; they show whether the count stands before the listed signals.
        context: gets the period and the names of the axes.

    Raises:
        ValueError: one line; a header without signals.
    """

    def __init__(self, header: Any, first: Sequence[Any], context: EdgeContext) -> None:
        listed = header.get("SignalListHFData") if isinstance(header, dict) else None
        signals = [each for each in listed or () if isinstance(each, dict)]
        if not signals or len(signals) > MOST_SIGNALS:
            raise ValueError("no SignalListHFData with signals in its Header")
        names = [str(each.get("Address") or each.get("Name") or "") for each in signals]
        for name, each in zip(names, signals, strict=True):
            context.name_axis(name, str(each.get("Axis") or ""))
        context.period_s = _period_s(header.get("CycleTimeMs"))
        width = len(first[0]) if first and _is_row(first[0]) else 0
        if width == len(names) + 1 and EDGE_CYCLE not in names:
            names.insert(0, EDGE_CYCLE)  # each row begins with its count, listed or not
        self.names = tuple(names)
        self.ragged_rows = 0
        self._text: dict[str, Text] = {}

    def numbers(self, rows: Sequence[Any]) -> tuple[Floats, Booleans]:
        """Numbers of the rows that are whole, (m, signals), and which those are, (n,)."""
        width = len(self.names)
        whole = np.array([_is_row(row) and len(row) == width for row in rows], dtype=bool)
        self.ragged_rows += int(np.count_nonzero(~whole))
        kept = [row for row, each in zip(rows, whole, strict=True) if each]
        try:
            samples = np.array(kept, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            samples = np.empty(0)
        if samples.shape != (len(kept), width):
            cells = [
                [self._cell(*each) for each in zip(self.names, row, strict=True)] for row in kept
            ]
            samples = np.array(cells, dtype=np.float64).reshape(-1, width)
        return samples, whole

    def take_text(self) -> dict[str, Text]:
        """Texts that stood in place of numbers since the last call, by signal."""
        text, self._text = self._text, {}
        return text

    def _cell(self, name: str, value: Any) -> float:
        if value is None:
            return math.nan
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            before = self._text.get(name, Text(0, str(value)[:40]))
            self._text[name] = Text(before.count + 1, before.first)
            return math.nan


def _is_row(row: Any) -> bool:
    return isinstance(row, list)


def _period_s(cycle_time_ms: Any) -> float | None:
    try:
        period_s = float(cycle_time_ms) / 1e3
    except (TypeError, ValueError, OverflowError):
        return None
    return period_s if SHORTEST_S <= period_s <= LONGEST_S else None
