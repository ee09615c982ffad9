"""A kept history of some hours, and a disk that fails at a call of its own choice."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.health.history.archive import AxisArchive
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate

NS = 1_000_000_000
START_S = 1_769_817_600.0  # midnight, UTC
HOURS = 2
STEP_S = 30.0
END_S = START_S + 3600.0 * HOURS + 600.0
CHANGING = ("open", "write", "pwrite", "fsync", "replace", "rename", "link")
CHANGING += ("unlink", "truncate", "ftruncate", "mkdir")
"""Calls of `os` that change what is on the disk."""


def estimate(value: float) -> PreloadEstimate:
    """Estimate with a number of its own."""
    return PreloadEstimate(
        time_s=0.0,
        status=EstimateStatus.ESTIMATED,
        preload_percent=value,
        low=value - 1.0,
        high=value + 2.0,
        drag_torque_nm=Interval(value=value / 50.0, low=0.0, high=1.0),
        nis=1.5,
    )


def append(archive: AxisArchive, time_s: float) -> None:
    """Let an archive take in the estimate of a time, which tells its value."""
    archive.append(round(time_s * NS), estimate(value_at(time_s)), 21.5)


def value_at(time_s: float) -> float:
    """Preload that was estimated at a time, percent."""
    return 1.0 + time_s % 1009.0 / 100.0


TIMES_S = np.arange(START_S, END_S, STEP_S)


def kept_history(folder: Path) -> None:
    """Keep all TIMES_S in a folder: compacted hours, and an open one in the log."""
    archive = AxisArchive(folder)
    for time_s in TIMES_S.tolist():
        append(archive, time_s)
        if time_s % 3600.0 == 0.0:
            archive.flush()
    archive.flush(sync=True)


def check_rows(archive: AxisArchive) -> dict[float, set[float]]:
    """Compare every row of every resolution with what was appended; times by resolution.

    No time appears twice, and no row says what was not kept.
    """
    found = {}
    for step_s in (1.0, 60.0, 3600.0):
        rows = archive.rows(START_S - 86400.0, END_S + 86400.0, step_s)
        assert len(set(rows.time_s.tolist())) == len(rows)
        covered = []
        for number, time_s in enumerate(rows.time_s.tolist()):
            samples = int(rows.samples[number])
            inside = [time_s + STEP_S * each for each in range(samples)]
            covered += inside
            values = [value_at(each) for each in inside]
            assert rows.mean[0, number] == pytest.approx(np.mean(values))
            assert rows.least[0, number] == min(values)
            assert rows.most[0, number] == max(values)
        assert len(set(covered)) == len(covered)
        assert set(covered) <= set(TIMES_S.tolist())
        found[step_s] = set(covered)
    return found


class FailingDisk:
    """Stand-in for the file-changing calls of `os`: counts them, and fails when told.

    Args:
        first: number of the first call that fails, from 0; None: none does.
        last: number of the last one; None: all that follow fail as well.
        error: what they raise.
    """

    def __init__(
        self,
        first: int | None = None,
        last: int | None = None,
        error: Callable[[], BaseException] = RuntimeError,
    ) -> None:
        self.calls = 0
        self._first, self._last, self._error = first, last, error

    def fails(self) -> bool:
        """Count a call; whether it fails."""
        number = self.calls
        self.calls += 1
        after = self._first is not None and number >= self._first
        return after and (self._last is None or number <= self._last)

    def wrapped(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Call of `os` on this disk; half of a write that fails is done, and syncing is quick."""

        def changed(*args: Any, **kwargs: Any) -> Any:
            if name == "open" and not args[1] & (os.O_WRONLY | os.O_RDWR):
                return call(*args, **kwargs)
            if self.fails():
                if name in ("write", "pwrite"):
                    call(args[0], args[1][: len(args[1]) // 2], *args[2:])
                raise self._error()
            return None if name == "fsync" else call(*args, **kwargs)

        return changed


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[FailingDisk], None]]:
    """Setter of the disk that `os` works on."""
    real = {name: getattr(os, name) for name in CHANGING}

    def use(disk: FailingDisk) -> None:
        for name, call in real.items():
            monkeypatch.setattr(os, name, disk.wrapped(name, call))

    yield use
    monkeypatch.undo()
