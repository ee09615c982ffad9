"""An error in one message: counted, told once a minute for each kind, and the next is handled."""

import asyncio
import time

import pytest

from edge_service.bus.session import Bus, BusSettings
from edge_service.messages.alarm import Command
from edge_service.messages.keys import MachineKeys
from edge_service.messages.topics import COMMAND
from edge_service.nodes.supervision.failures import TOLD_AGAIN_S, Failures
from edge_service.nodes.supervision.supervisor import Supervisor

from ..conftest import until

BAD = "poison"
KEY = MachineKeys("site", "machine").key("X", COMMAND)


async def test_a_bad_message_costs_itself_alone() -> None:
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    told, taken = [], []
    tasks = Supervisor().tasks("part", told.append)

    async def take(_axis, _header, command) -> None:
        await asyncio.sleep(0)
        if command.note == BAD:
            raise LookupError(BAD)
        taken.append(command.note)

    try:
        subscriber = bus.subscribe(KEY, COMMAND)
        publisher = bus.publisher(KEY, COMMAND, "X")
        task = tasks.follow("commands", subscriber, take)
        for note in ("one", BAD, BAD, "two"):
            publisher.publish(Command(action="note", user="u", note=note), time.time_ns())

        async def two() -> bool:
            return len(taken) == 2

        await until(two)
        assert (tasks.failures.count, task.restarts.total) == (2, 0)
        ((kind, reason),) = [(change.kind, change.reason) for change in told]
        assert kind == "message_failed"
        assert "axis X: LookupError: poison at test_failures.py" in reason
        assert "commands cannot handle" in tasks.faults()[0]
    finally:
        await tasks.end()
        await bus.close()


def test_each_kind_is_told_once_a_minute_and_all_are_counted() -> None:
    now, told = [0.0], []
    failures = Failures(lambda where, reason: told.append((where, reason)), lambda: now[0])
    for kind in (ValueError, KeyError):
        for _ in range(100):
            with failures.borne("task", "X"):
                raise kind("x")
    assert (failures.count, len(told), len(failures.now())) == (200, 2, 1)
    now[0] = TOLD_AGAIN_S
    assert failures.now() == []
    with failures.borne("task", "X"):
        raise ValueError("x")
    assert len(told) == 3


def test_axes_that_nobody_knows_do_not_fill_the_memory() -> None:
    failures = Failures(lambda _where, _reason: None, lambda: 0.0)
    for number in range(1000):
        with failures.borne("task", f"axis {number}" * 100):
            raise ValueError
    assert len(failures._told_s) <= 100


async def test_a_cancellation_is_no_failure() -> None:
    failures = Failures(lambda _where, _reason: None, lambda: 0.0)
    with pytest.raises(asyncio.CancelledError), failures.borne("task"):
        raise asyncio.CancelledError
    assert failures.count == 0
