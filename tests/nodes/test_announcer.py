"""Tests of the queue in front of the bus: nothing in hand is lost with the task that had it."""

import asyncio
import threading
from collections.abc import Sequence

import pytest

from edge_service.messages.event import Event, Severity
from edge_service.messages.health import AxisCondition, AxisHealth
from edge_service.nodes.wiring.announcer import Announcement, Announcer

from .conftest import heart


def announcement(number: int) -> Announcement:
    """One event of the axis, known by its number."""
    event = Event(
        axis="X", kind="note", severity=Severity.INFO, message=f"{number}", time_ns=number
    )
    health = AxisHealth(axis="X", condition=AxisCondition.NORMAL, since_time_ns=0)
    return Announcement("X", (event,), health)


class Scene:
    """An announcer before a disk that answers when it is let."""

    def __init__(self) -> None:
        self.disk = threading.Event()
        self.kept: list[str] = []
        self.told: list[str] = []
        self.announcer = Announcer(self.keep, self.publish)

    def keep(self, batch: Sequence[Announcement]) -> str:
        self.disk.wait(10.0)
        self.kept += [each.events[0].message for each in batch]
        return ""

    def publish(self, one: Announcement) -> None:
        self.told.append(one.events[0].message)

    async def until_idle(self) -> None:
        async with asyncio.timeout(10.0):
            while not self.announcer.idle:
                await asyncio.sleep(0.001)


@pytest.mark.parametrize("turns", range(8))
async def test_what_an_ended_task_had_in_hand_is_told_by_the_next(turns: int) -> None:
    scene = Scene()
    writing = asyncio.create_task(scene.announcer.write(heart()))
    first = asyncio.create_task(scene.announcer.announce(heart()))
    scene.announcer.put(announcement(1))
    for _ in range(turns):
        await asyncio.sleep(0)
    first.cancel()
    await asyncio.gather(first, return_exceptions=True)
    scene.announcer.put(announcement(2))
    scene.disk.set()
    second = asyncio.create_task(scene.announcer.announce(heart()))
    await scene.until_idle()
    for task in (second, writing):
        task.cancel()
    await asyncio.gather(second, writing, return_exceptions=True)
    assert scene.told == ["1", "2"]
    assert scene.kept == ["1", "2"]


@pytest.mark.parametrize("turns", range(8))
async def test_what_was_in_hand_at_the_end_is_kept_and_told_once(turns: int) -> None:
    scene = Scene()
    task = asyncio.create_task(scene.announcer.announce(heart()))
    scene.announcer.put(announcement(1))
    for _ in range(turns):
        await asyncio.sleep(0)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    scene.announcer.put(announcement(2))
    scene.disk.set()
    scene.announcer.flush()
    assert scene.told == ["1", "2"]
    assert scene.kept == ["1", "2"]
