"""What came into the diary reaches the outputs, also if the service ended in between."""

import asyncio
import json
from pathlib import Path

from pydantic import SecretStr

from edge_service.bus.mqtt.packet import GONE
from edge_service.bus.session import Bus, BusSettings
from edge_service.bus.spool.message import DeadLetter
from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import StoreConfig, WebhookConfig
from edge_service.health.store.events import EventLog
from edge_service.health.store.store import Store
from edge_service.messages.event import Event, Severity
from edge_service.nodes.mqtt_node import SENT
from edge_service.nodes.outputs.desk import OutputDesk
from edge_service.nodes.outputs.missed import MissedEvents
from edge_service.nodes.wiring.context import NodeContext

from ..drivers.bench import free_port
from ..messages.examples import HEADER, PAYLOADS
from .conftest import config_of


def _event(number: int, kind: str = "note") -> Event:
    return Event(axis="X", kind=kind, severity=Severity.INFO, message=str(number), time_ns=number)


async def _waiting(context: NodeContext) -> list[str]:
    """Messages that wait after a start."""
    desk = await OutputDesk.open(context)
    ((output, _),) = desk._outputs.values()
    letters = await output.spool.oldest(100)
    desk.close()
    return [letter.payload.decode().partition('"message": "')[2][0] for letter in letters]


async def test_mqtt_catches_up_with_the_diary_and_sends_nothing_twice(tmp_path: Path) -> None:
    diary = EventLog(Store(tmp_path / "diary.sqlite"))

    async def started(*heard: Event) -> list[str]:
        """Events that wait after a start, and after events that were heard."""
        spool = await Spool.open(tmp_path / "spool", 100)
        missed = MissedEvents(diary, spool, ["X"])
        await missed.put()
        for event in heard:
            await spool.put(
                "X/event", event.model_dump_json().encode(), mark=await missed.number(event)
            )
        letters = await spool.oldest(100)
        await asyncio.to_thread(spool.close)
        return [json.loads(letter.payload)["message"] for letter in letters]

    diary.add([_event(0)], 10**18)
    assert await started() == []
    diary.add([_event(1), _event(2), _event(3)], 10**18)
    assert await started() == ["1", "2", "3"]
    diary.add([_event(4), _event(5)], 10**18)
    assert await started() == ["1", "2", "3", "4", "5"]
    diary.store.close()
    diary = EventLog(Store(tmp_path / "diary.sqlite"))
    spoken = _event(6)
    assert await started(_event(7)) == ["1", "2", "3", "4", "5", "7"]  # not of this diary
    diary.add([spoken], 10**18)
    assert await started() == ["1", "2", "3", "4", "5", "7", "6"]
    diary.store.close()


async def test_dead_letters_of_a_node_beside_are_shown_and_tried_again(tmp_path: Path) -> None:
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    context = NodeContext(config_of("simulated", {}), bus)
    desk = await OutputDesk.open(context)
    assert await desk.dead_letters("mqtt") == []
    spool = context.spools["mqtt"] = await Spool.open(tmp_path / "spool", 100)
    for topic in SENT:
        await spool.put(f"X/{topic.name}", topic.encode("X", HEADER, PAYLOADS[topic.name]))
    await spool.put(f"X/{GONE}", b"")
    for each in await spool.oldest(10):
        await spool.bury(DeadLetter(each.key, each.topic, each.payload, 7, "lost", 5))
    shown = await desk.dead_letters("mqtt")
    assert [(each.axis, each.kind, each.tries) for each in shown] == [
        ("X", "preload", 7),
        ("X", "health", 7),
        ("X", "alarm_raised", 7),
        ("X", "gone", 7),
    ]
    await desk.forget("mqtt", shown[0].id)
    await desk.revive("mqtt", shown[1].id)
    await desk.revive_all("mqtt")
    assert (len(spool), spool.dead) == (3, 0)
    await asyncio.to_thread(spool.close)
    await bus.close()


async def test_an_event_between_diary_and_output_is_sent_after_the_next_start(
    tmp_path: Path,
) -> None:
    webhook = WebhookConfig(
        url=SecretStr(f"http://127.0.0.1:{free_port()}/"),
        secret=SecretStr("a secret of some length"),
        kinds=("note",),
        buffer=tmp_path / "spool",
    )
    config = config_of("simulated", {}, webhook=webhook, store=StoreConfig(folder=tmp_path))
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    context = NodeContext(config, bus)
    diary = context.events
    diary.add([_event(0)], 10**18)
    assert await _waiting(context) == []  # it was before there was an output
    diary.add([_event(1), _event(2, "alarm_raised"), _event(3)], 10**18)
    assert await _waiting(context) == ["1", "3"]
    assert await _waiting(context) == ["1", "3"]  # and once only
    await asyncio.to_thread(diary.close)
    await bus.close()
