"""Letters about events: gathered, bounded, by level, in two languages, to each URL by itself."""

import asyncio
from collections import deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from edge_service.clock import now_ns
from edge_service.health.store.events import EventLog, StoredEvent
from edge_service.health.store.outbox import Outbox
from edge_service.health.store.store import Store
from edge_service.http_api.app import words_in
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import ComponentStatus
from edge_service.nodes.output_node import OutputNode, due
from edge_service.outputs.base import Events, Output
from edge_service.outputs.notify import NotifyOutput
from edge_service.plugins import MisconfiguredError

from ...drivers.bench import free_port
from ...nodes.conftest import until
from ..bench import SECRET, event, output
from .receiver import Receiver


def made(folder: Path, urls: str, **table: object) -> Output:
    path = folder / "notify.urls"
    path.write_text(urls)
    path.chmod(0o600)
    return output("notify", {"urls_file": str(path), **table}, words=words_in, page="https://x/")


async def test_events_of_the_level_go_in_one_letter_and_others_in_none(tmp_path: Path) -> None:
    receiver = Receiver(free_port())
    await receiver.start()
    notify = made(tmp_path, f"json://127.0.0.1:{receiver.port}/", level="FAULT")
    await notify.open()
    (who,) = notify.receivers
    grave = event("preload at 17 %").model_copy(update={"level": AxisCondition.FAULT})
    await notify.take(Events(who, (event("not told"),)))
    await notify.take(Events(who, (event("not told"), grave, grave)))
    (letter,) = receiver.taken
    assert letter["title"] == "hall/mill X: preload at 17 % (+1)"
    assert "not told" not in letter["message"]
    assert letter["message"].endswith("https://x/")
    assert letter["type"] == "failure"
    await receiver.stop()


def test_each_url_has_a_queue_and_no_secret_in_its_name(tmp_path: Path) -> None:
    notify = made(tmp_path, f"json://u:{SECRET}@a/\n\n# more\nntfy://b/{SECRET}\n")
    assert [each.partition("-")[0] for each in notify.receivers] == ["json", "ntfy"]
    assert SECRET not in " ".join(notify.receivers)
    assert notify.kinds == {"alarm_raised", "alarm_cleared"}


@pytest.mark.parametrize("urls", ["", "# nobody", f"nothing://{SECRET}", f"{SECRET}"])
def test_a_file_without_a_url_is_refused(urls: str, tmp_path: Path) -> None:
    with pytest.raises(MisconfiguredError, match=r"^urls_file: [^\n]*$") as caught:
        made(tmp_path, urls)
    assert SECRET not in str(caught.value)


def test_a_file_that_others_can_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "notify.urls"
    path.write_text("json://a/")
    path.chmod(0o644)
    with pytest.raises(MisconfiguredError, match="chmod 600"):
        output("notify", {"urls_file": str(path)}, words=words_in)


def test_letters_are_gathered_and_twelve_an_hour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notify = made(tmp_path, "json://a/")
    at_ns = now_ns()

    def waiting(age_s: float) -> list[StoredEvent]:
        old = event().model_copy(update={"time_ns": at_ns - round(age_s * 1e9)})
        return [StoredEvent(1, old), StoredEvent(2, event())]

    monkeypatch.setattr("edge_service.nodes.output_node.time.monotonic", lambda: 4000.0)
    monkeypatch.setattr("edge_service.nodes.output_node.now_ns", lambda: at_ns)
    assert due(notify, waiting(29.0), deque()) == []
    assert len(due(notify, waiting(31.0), deque())) == 2
    assert due(notify, waiting(31.0), deque([3000.0] * 12)) == []
    assert len(due(notify, waiting(31.0), deque([300.0] * 6 + [3000.0] * 6))) == 2
    assert due(notify, [], deque()) == []


async def test_an_event_that_cannot_be_told_holds_up_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = lambda _, events: ("a title", f"{events[0].values['number']:.3g}")  # noqa: E731
    monkeypatch.setattr(NotifyOutput, "gather_s", 0.0)
    monkeypatch.setattr(NotifyOutput, "letter", told)
    receiver = Receiver(free_port())
    await receiver.start()
    notify = made(tmp_path, f"json://127.0.0.1:{receiver.port}/", level="NORMAL")
    (who,), log = notify.receivers, EventLog(Store(None))
    component: Any = SimpleNamespace(status=ComponentStatus.OK, publish=lambda: None, name="notify")
    outbox = Outbox(log.store, notify.queue(who), notify.kinds, log)
    assert outbox.waiting(1) == []
    for values in ({}, {"number": 1.0}):
        log.add([event().model_copy(update={"values": values, "time_ns": now_ns()})], now_ns())
    task = asyncio.create_task(OutputNode(notify, component, log, ()).deliver(who))
    await until(lambda: task.done() or not outbox.waiting(1), 60.0)  # the machine may be busy
    is_done = task.done()
    task.cancel()
    await receiver.stop()
    assert (outbox.counts().dead, bool(receiver.taken), is_done) == (1, True, False)
