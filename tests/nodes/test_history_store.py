"""The history of all axes: what fails for one is told and stops no other."""

import errno
import os
import time
from pathlib import Path

import pytest

from edge_service.config import DEFAULT_MACHINE, AxisConfig
from edge_service.config_tables import HistoryConfig
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event
from edge_service.messages.health import ComponentStatus
from edge_service.nodes.stores.history_store import HistoryStore, open_history
from edge_service.nodes.stores.history_watch import HistoryWatch, Turn

from .conftest import config_of

NS = 1_000_000_000
NOW_S = 1_769_817_600.0


def _store(folder: Path) -> HistoryStore:
    axes = [AxisConfig(name=name, machine=DEFAULT_MACHINE, driver="simulated") for name in "XY"]
    config = config_of("simulated", {}, axes=axes, history=HistoryConfig(folder=folder))
    return open_history(config, {})


def _append(store: HistoryStore, time_s: float) -> None:
    estimate = PreloadEstimate(time_s=0.0, status=EstimateStatus.ESTIMATED, preload_percent=5.0)
    for archive in store.keeping.archives.values():
        archive.append(round(time_s * NS), estimate)


def _kept(store: HistoryStore, axis: str) -> int:
    rows = store.keeping.archives[axis].rows(NOW_S - 1e5, NOW_S + 1e5, 0.1)
    return len(rows)


def test_a_damaged_file_of_one_axis_is_told_and_nothing_of_another(tmp_path: Path) -> None:
    store = _store(tmp_path)
    for time_s in (NOW_S, NOW_S + 3600.0):
        _append(store, time_s)
        assert store._turn(sync=True).problems == []
    store.close()
    (damaged,) = (tmp_path / "axis=X" / "raw").glob("*T00.parquet")
    damaged.write_bytes(b"PAR1")
    again = _store(tmp_path)
    turns = [again._turn(sync=True) for _ in range(3)]
    told = [damage for turn in turns for damage in turn.damages]
    assert [(axis, str(damaged) in words) for axis, words in told] == [("X", True)]
    assert all(turn.problems == [] for turn in turns)
    assert _kept(again, "Y") == 2
    again.close()


@pytest.mark.parametrize("hit", ["axis=X", "axis=Y"])
def test_an_axis_whose_files_cannot_be_written_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hit: str
) -> None:
    store, real_open = _store(tmp_path), os.open

    def failing(path: object, *rest: int, **more: int) -> int:
        if hit in str(path):
            raise OSError(errno.EIO, "Input/output error", str(path))
        return real_open(path, *rest, **more)

    monkeypatch.setattr(os, "open", failing)
    _append(store, NOW_S)
    (problem,) = store._turn(sync=True).problems
    assert problem.startswith(f"axis {hit[-1]}: Input/output error")
    sound = {"axis=X", "axis=Y"} - {hit}
    assert [path.parent.name for path in tmp_path.rglob("open.log")] == list(sound)
    monkeypatch.undo()
    assert store._turn(sync=True).problems == []
    assert len(list(tmp_path.rglob("open.log"))) == 2
    store.close()


def test_a_start_without_a_writable_folder_is_in_memory_until_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_mkdir = os.mkdir

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "mkdir", full)
    store = _store(tmp_path / "kept")
    _append(store, NOW_S)
    assert store._turn(sync=True).problems == ["No space left on device"]
    assert _kept(store, "X") == 1
    monkeypatch.setattr(os, "mkdir", real_mkdir)
    _append(store, NOW_S + 1.0)
    assert store._turn(sync=True).problems == []
    store.close()
    assert _kept(_closed(tmp_path / "kept"), "Y") == 2


def _closed(folder: Path) -> HistoryStore:
    store = _store(folder)
    store.close()
    return store


def test_what_a_crash_left_unfinished_goes_and_what_is_in_work_stays(tmp_path: Path) -> None:
    raw = tmp_path / "axis=X" / "raw"
    raw.mkdir(parents=True)
    left = [raw / ".2026-01-31T00.parquet.0a1b2c3d.part", raw / ".2026.parquet.a1_b2c3d"]
    left.append(tmp_path / "axis=X" / ".watch.json.0a1b2c3d.part")
    new, other = tmp_path / ".state.json.0a1b2c3d.part", raw / ".hidden"
    for path in (*left, new, other):
        path.touch()
    os.utime(left[-1], (time.time() - 7200.0, time.time() - 7200.0))
    _closed(tmp_path)
    assert [path.exists() for path in (*left, new, other)] == [False] * 3 + [True] * 2


def test_problems_are_a_status_and_an_event_once_and_so_is_their_end() -> None:
    statuses: list[tuple[ComponentStatus, str]] = []
    events: list[Event] = []
    watch = HistoryWatch(lambda *report: statuses.append(report), events.append)
    for problems in ([], ["disk full"], ["disk full"], []):
        watch.take(Turn(problems=problems))
    assert [status for status, _ in statuses] == [
        ComponentStatus.OK,
        ComponentStatus.RECOVERABLE_ERROR,
        ComponentStatus.RECOVERABLE_ERROR,
        ComponentStatus.OK,
    ]
    assert "disk full" in statuses[1][1]
    assert [event.kind for event in events] == ["history_failing", "history_kept"]
    assert watch.counts()["failed_turns"] == 2


def test_damage_is_an_event_of_its_axis_and_counted() -> None:
    events: list[Event] = []
    watch = HistoryWatch(lambda *_: None, events.append)
    watch.take(Turn(damages=[("X", "raw/1.parquet: its checksum is wrong")], lost=3, adopted=2))
    (event,) = events
    assert (event.axis, event.kind) == ("X", "history_damaged")
    assert "raw/1.parquet" in event.message
    assert watch.counts() == {"damages": 1, "failed_turns": 0, "lost_estimates": 3, "adopted": 2}


def test_files_of_the_future_are_told_once_and_counted_until_they_are_gone() -> None:
    events: list[Event] = []
    watch = HistoryWatch(lambda *_: None, events.append)
    for names in (["2100.parquet"], ["2100.parquet"], ["2100.parquet", "2101.parquet"]):
        watch.take(Turn(future={"X": names, "Y": []}))
        watch.take(Turn())
        assert watch.readings() == {"future_files": len(names)}
    assert [(each.axis, each.kind) for each in events] == [("X", "history_from_future")] * 2
    assert "2101.parquet" in events[-1].message
    watch.take(Turn(future={"X": [], "Y": []}))
    assert (watch.readings(), len(events)) == ({"future_files": 0.0}, 2)
