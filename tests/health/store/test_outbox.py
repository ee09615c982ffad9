"""An output's cursor in the table of events."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.clock import now_ns
from edge_service.health.store import outbox as module
from edge_service.health.store.events import EventLog
from edge_service.health.store.outbox import Outbox
from edge_service.health.store.store import Store, StoreFailedError
from tests.messages.examples import event_of


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with closing(Store(tmp_path / "a.sqlite")) as made:
        yield made


def tell(store: Store, *texts: str, kind: str = "note") -> list[int]:
    """Keep events; returns their numbers."""
    at_ns = now_ns()
    events = [event_of(text, kind=kind, time_ns=at_ns) for text in texts]
    return [each.id for each in EventLog(store).add(events, at_ns)]


def texts(outbox: Outbox) -> list[str]:
    return [each.event.text for each in outbox.waiting(100)]


def test_a_new_output_begins_with_the_events_to_come(store: Store) -> None:
    Outbox(store, "other")
    tell(store, "before")
    outbox = Outbox(store, "mqtt")
    assert texts(outbox) == []
    one, two = tell(store, "one", "two")
    assert texts(outbox) == ["one", "two"]
    outbox.delivered(one)
    assert texts(Outbox(store, "mqtt")) == ["two"]
    outbox.delivered(two)
    assert outbox.counts() == (0, 0, None)
    assert texts(Outbox(store, "opcua")) == []


def test_an_output_is_told_of_its_kinds_alone(store: Store) -> None:
    outbox, every = Outbox(store, "mqtt", {"note", "alarm_raised"}), Outbox(store, "opcua")
    assert outbox.waiting(1) == every.waiting(1) == []
    tell(store, "one")
    tell(store, "chatter", kind="data_fault")
    tell(store, "two", kind="alarm_raised")
    assert (texts(outbox), texts(every)) == (["one", "two"], ["one", "chatter", "two"])
    assert [each.event.text for each in every.waiting(2)] == ["one", "chatter"]
    assert outbox.counts()[:2] == (2, 0)
    assert texts(Outbox(store, "opcua", ())) == []


def test_a_dead_letter_is_passed_over_until_it_is_requeued(store: Store) -> None:
    outbox = Outbox(store, "mqtt")
    assert outbox.waiting(1) == []
    one, two, _three = tell(store, "one", "two", "three")
    outbox.refused(one, "550 no such user")
    outbox.delivered(two)
    assert texts(outbox) == ["three"]
    assert outbox.counts()[:2] == (1, 1)
    assert (outbox.requeue(), texts(outbox)) == (1, ["one", "three"])
    outbox.refused(one, "550 again")
    assert (outbox.drop(), texts(outbox)) == (1, ["three"])
    assert outbox.counts()[:2] == (1, 0)
    assert (outbox.requeue(), outbox.drop()) == (0, 0)


def test_a_requeued_letter_that_is_delivered_is_gone(store: Store) -> None:
    outbox = Outbox(store, "mqtt")
    assert outbox.waiting(1) == []
    one, two = tell(store, "one", "two")
    outbox.refused(one, "no")
    outbox.delivered(two)
    outbox.requeue()
    outbox.delivered(one)
    assert texts(outbox) == []
    assert outbox.counts()[:2] == (0, 0)


def test_what_is_too_old_waits_no_more(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    outbox = Outbox(store, "mqtt")
    assert outbox.waiting(1) == []
    one, _two = tell(store, "one", "two")
    outbox.refused(one, "no")
    later_ns = now_ns() + module.KEPT_NS + 10**9
    monkeypatch.setattr(module, "now_ns", lambda: later_ns)
    assert texts(outbox) == []
    outbox.refused(0, "another")
    assert outbox.counts()[:2] == (0, 1)


def test_a_row_that_is_not_what_was_written_is_passed_over(store: Store) -> None:
    outbox = Outbox(store, "mqtt")
    assert outbox.waiting(1) == []
    tell(store, "one", "two")
    change = "UPDATE events SET body = replace(body, 'one', 'ONE')"
    store.write(lambda file: file.execute(change))
    assert texts(outbox) == ["two"]


def test_what_a_full_disk_leaves_in_memory_is_delivered_once(store: Store) -> None:
    log = EventLog(store)
    outbox = Outbox(store, "notify", ["note"], log)
    assert texts(outbox) == []
    pages = store.write(lambda file: file.execute("PRAGMA page_count").fetchone()[0])
    store.write(lambda file: file.execute(f"PRAGMA max_page_count = {pages}").fetchone())
    at_ns = now_ns()
    kinds = ("note", "alarm_raised")
    told = [event_of("x" * 9000, kind=kind, time_ns=at_ns) for kind in kinds]
    with pytest.raises(StoreFailedError, match="full"):
        log.add(told, at_ns)
    (waiting,) = outbox.waiting(10)
    assert waiting.event == told[0]
    outbox.delivered(waiting.id)
    assert outbox.waiting(10) == []
    store.write(lambda file: file.execute("PRAGMA max_page_count = 100000").fetchone())
    log.save()
    assert (log.waiting, outbox.waiting(10)) == (0, [])
    (number,) = tell(store, "next")
    assert [each.id for each in outbox.waiting(10)] == [number]
