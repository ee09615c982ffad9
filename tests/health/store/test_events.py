"""The log of events: numbers, rooms, pages, and a disk that takes nothing for a while."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from edge_service.health.store import events as module
from edge_service.health.store.events import EventLog
from edge_service.health.store.store import State, Store, StoreFailedError, load_state
from tests.messages.examples import event_of

NS = 10**9
NOW_NS = 1_795_000_000 * NS
MS = 1_000_000
event = partial(event_of, time_ns=NOW_NS)


@pytest.fixture(params=[True, False], ids=["file", "memory"])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[EventLog]:
    with closing(Store(tmp_path / "a.sqlite" if request.param else None)) as store:
        yield EventLog(store)


def messages(found: Any) -> list[str]:
    return [each.event.text for each in found]


def full(log: EventLog, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on the disk takes nothing."""

    def write(_work: object) -> None:
        raise StoreFailedError("the disk is full")

    monkeypatch.setattr(log.store, "write", write)


def test_numbers_grow_and_tell_the_time(log: EventLog) -> None:
    one, two = log.add([event("one"), event("two")], NOW_NS)
    (three,) = log.add([event("three")], NOW_NS - 3600 * NS)
    assert NOW_NS // 1000 == one.id < two.id < three.id == log.last_id()
    (late,) = log.add([event("late")], 2**62)
    assert three.id < late.id < 2**53


def test_an_event_that_is_there_is_not_doubled(log: EventLog) -> None:
    first = log.add([event("one")], NOW_NS)
    again = log.add([event("two"), event("one")], NOW_NS + NS)
    assert again[1] == first[0]
    assert messages(log.after(0, 10)) == ["one", "two"]


def test_pages_go_back_from_the_newest(log: EventLog) -> None:
    log.add([event(str(number), time_ns=NOW_NS + number * MS) for number in range(5)], NOW_NS)
    log.add([event("other", axis="Y"), event("service", axis=""), event("c", kind="command")], 1)
    assert messages(log.page(3)) == ["c", "service", "other"]
    assert messages(log.page(3, "X")) == ["c", "service", "4"]
    assert messages(log.page(9, "Y")) == ["service", "other"]
    assert messages(log.page(9, kinds=["command"])) == ["c"]
    assert messages(log.page(9, "X", ["note"], NOW_NS + MS, NOW_NS + 4 * MS)) == ["3", "2", "1"]
    (oldest,) = log.page(1, before_id=log.page(7)[-1].id)
    assert oldest.event.text == "0"
    assert log.page(9, start_ns=2**70) == []


def test_what_waits_is_found_and_written_with_the_next(
    log: EventLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    log.add([event("kept")], NOW_NS)
    with monkeypatch.context() as broken:
        full(log, broken)
        (put,) = log.put([event("waits")], NOW_NS, [State("monitor", "X", "[1]")])
        with pytest.raises(StoreFailedError):
            log.save()
        assert log.waiting == 1
        assert messages(log.after(0, 10)) == ["kept", "waits"]
        assert messages(log.page(10, "X")) == ["waits", "kept"]
        assert messages(log.page(1, "X", ["note"])) == ["waits"]
    assert log.save() == {put.id: put.id}
    assert log.waiting == 0
    assert log.after(0, 10)[1] == put
    assert load_state(log.store, "monitor", "X") == [1]


def test_chatter_goes_first_where_memory_is_bounded(
    log: EventLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MOST_WAITING", 3)
    full(log, monkeypatch)
    log.put([event("a"), event("b", kind="data_fault"), event("c"), event("d")], NOW_NS)
    with pytest.raises(StoreFailedError):
        log.save()
    assert (log.waiting, log.lost) == (3, 1)
    assert [each.event.text for each in log._waiting.values()] == ["a", "c", "d"]


def test_an_event_that_cannot_be_written_holds_up_no_other(log: EventLog) -> None:
    """A clock that is beyond the year 2262."""
    events = [event("before"), event("poison", time_ns=2**70), event("after")]
    log.put(events, NOW_NS, [State("monitor", "X", "[1]")])
    log.save()
    assert messages(log.after(0, 10)) == ["before", "after"]
    assert (log.waiting, log.set_aside) == (0, 1)
    assert load_state(log.store, "monitor", "X") == [1]


def test_events_and_states_are_written_together_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.sqlite"

    def crash(_file: sqlite3.Connection, _events: object) -> None:
        raise KeyboardInterrupt

    with closing(Store(path)) as store:
        log = EventLog(store)
        with monkeypatch.context() as crashing:
            crashing.setattr(module, "append_events", crash)
            log.put([event("raised")], NOW_NS, [State("monitor", "X", "[1]")])
            with pytest.raises(KeyboardInterrupt):
                log.save()
    with closing(Store(path)) as store:
        log = EventLog(store)
        assert log.after(0, 10) == []
        assert load_state(store, "monitor", "X") is None


def test_each_kind_has_its_own_room(log: EventLog, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_CHATTER", 40)
    (note,) = log.add([event("a person")], NOW_NS)
    for number in range(30):
        at = NOW_NS + number * NS
        log.add([event(f"{number} {each}", kind="data_fault", time_ns=at) for each in "ab"], at)
        log.add([event(f"{number} {each}", kind=f"odd_{each}", time_ns=at) for each in "ab"], at)
    rows = log.store.read(
        lambda file: file.execute("SELECT kind, COUNT(*) FROM events GROUP BY kind").fetchall()
    )
    assert dict(rows) == {"data_fault": 40, "note": 1, "other": 40}
    assert not log.holds_all_after(note.id)
    assert log.holds_all_after(log.last_id())


def test_a_row_that_is_not_what_was_written_is_left_out_and_said(tmp_path: Path) -> None:
    with closing(Store(tmp_path / "a.sqlite")) as store:
        log = EventLog(store)
        log.add([event("one"), event("two")], NOW_NS)
        store.write(lambda file: file.execute("UPDATE events SET body = replace(body, 'e', 'E')"))
        assert log.after(0, 10) == log.page(10) == []
        assert (log.counters()["events_damaged"], len(store.damages)) == (2, 2)
