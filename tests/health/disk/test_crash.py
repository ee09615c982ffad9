"""The power fails, or the disk does for a while, at any call that changes a file."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from edge_service.health.history.archive import AxisArchive

from .conftest import TIMES_S, FailingDisk, append, check_rows

UseDisk = Callable[[FailingDisk], None]
ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EDQUOT, errno.EMFILE)


class PowerFailure(BaseException):
    """Nothing that follows is done any more."""


def _live(folder: Path, acknowledged: set[float], turns: range, patient: bool) -> AxisArchive:
    """Append and flush in turns; a patient service goes on when that fails."""
    archive = AxisArchive(folder)
    step = len(TIMES_S) // len(turns) + 1
    waiting: set[float] = set()
    for turn in turns:
        for time_s in TIMES_S[turn * step : (turn + 1) * step].tolist():
            append(archive, time_s)
            waiting.add(time_s)
        try:
            archive.flush(sync=True)
        except OSError:
            if not patient:
                raise
        else:
            acknowledged |= waiting
            waiting = set()
    return archive


TURNS = range(7)


def _calls(folder: Path, use: UseDisk) -> int:
    disk = FailingDisk()
    use(disk)
    _live(folder, set(), TURNS, patient=False)
    return disk.calls


def test_after_a_power_failure_at_any_call_all_that_was_synced_is_there_once(
    tmp_path: Path, on_disk: UseDisk
) -> None:
    calls = _calls(tmp_path / "whole", on_disk)
    assert calls > 50
    for number in range(calls):
        folder, acknowledged = tmp_path / str(number), set()
        on_disk(FailingDisk(number, None, PowerFailure))
        with pytest.raises(PowerFailure):
            _live(folder, acknowledged, TURNS, patient=False)
        on_disk(FailingDisk())
        opened = AxisArchive(folder)
        for _ in range(2):
            found = check_rows(opened)
            for step_s, times in found.items():
                assert times >= acknowledged, (number, step_s)
            opened.flush(sync=True)


@pytest.mark.parametrize("error", ERRORS, ids=errno.errorcode.get)
def test_what_a_failing_disk_did_not_take_is_written_when_it_does(
    tmp_path: Path, on_disk: UseDisk, error: int
) -> None:
    calls = _calls(tmp_path / "whole", on_disk)
    for number in range(error % 7, calls, 7):
        folder = tmp_path / str(number)
        on_disk(FailingDisk(number, number + 40, lambda: OSError(error, os.strerror(error))))
        archive = _live(folder, set(), TURNS, patient=True)
        assert check_rows(archive)[1.0] == set(TIMES_S.tolist())
        on_disk(FailingDisk())
        archive.flush(sync=True)
        assert check_rows(archive)[3600.0] == set(TIMES_S.tolist())
        opened = AxisArchive(folder)
        assert set(map(frozenset, check_rows(opened).values())) == {frozenset(TIMES_S.tolist())}
        assert opened.take_damages() == []


def test_a_question_writes_nothing(tmp_path: Path, on_disk: UseDisk) -> None:
    archive = AxisArchive(tmp_path / "X")
    append(archive, TIMES_S[0])
    disk = FailingDisk(0, None, lambda: OSError(errno.ENOSPC, "full"))
    on_disk(disk)
    assert len(archive.rows(0.0, 1e10, 1.0)) == 1
    assert disk.calls == 0


def test_memory_is_bounded_while_nothing_can_be_written(
    tmp_path: Path, on_disk: UseDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("edge_service.health.history.open_records.MOST_RECORDS", 100)
    archive = AxisArchive(tmp_path / "X")
    on_disk(FailingDisk(0, None, lambda: OSError(errno.ENOSPC, "full")))
    for time_s in TIMES_S.tolist():
        append(archive, time_s)
        with pytest.raises(OSError, match="full"):
            archive.flush()
    on_disk(FailingDisk())
    archive.flush(sync=True)
    kept = AxisArchive(tmp_path / "X").rows(0.0, 1e10, 1.0).time_s.tolist()
    assert kept[-1] == TIMES_S[-1]
    assert len(kept) >= 100
    assert archive.lost == TIMES_S.size - len(kept)
    assert "lost" in archive.take_damages()[0]
