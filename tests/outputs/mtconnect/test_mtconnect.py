"""A foreign agent is told what holds; clients that misbehave cost nobody anything."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_service.messages.answer import AxisAnswer
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import AlarmKind, Limits
from edge_service.outputs import mtconnect
from edge_service.outputs import mtconnect as module
from edge_service.outputs.base import OutputContext

from ...messages.answers import MEASURED_NS, SILENT, alarm_of, answer, health_of
from ...nodes.conftest import until
from .agent import Agent, connected, item_types, tokens

NOW_NS = MEASURED_NS + 5_000_000
CONTEXT = OutputContext("mtconnect", "hall", "mill", ("X", "Y_Z", "1.b"))
DEVICES = mtconnect.devices_xml(CONTEXT, NOW_NS)
NUMBERS = ("preload_X", "preloadLow_X", "preloadHigh_X", "preloadForce_X", "dragTorque_X")
FIVE = Limits(fresh_percent=5.0, warning_percent=3.0, fault_percent=1.5)


def told(*answers: AxisAnswer) -> Agent:
    """State of an agent that was told one answer after the other."""
    agent, before = Agent(item_types(DEVICES)), {}
    for each in answers:
        after = mtconnect.values_of(each)
        for line in mtconnect.lines(mtconnect.changes(before, after), NOW_NS, each.measured_ns):
            agent.take(line)
        before = after
    return agent


@asynccontextmanager
async def serving() -> AsyncIterator[mtconnect.MtconnectOutput]:
    config = mtconnect.MtconnectConfig(endpoint="tcp://127.0.0.1:0")
    output = mtconnect.MtconnectOutput(config, CONTEXT)
    await output.open()
    await output.take(answer())
    try:
        yield output
    finally:
        await output.close()
        await asyncio.sleep(0)


async def nobody(adapter: mtconnect.MtconnectOutput) -> None:
    await until(lambda: adapter.readings["clients"] == 0)


@pytest.mark.parametrize("condition", AxisCondition)
def test_the_condition_is_the_services_own(condition: AxisCondition) -> None:
    for before in AxisCondition:
        agent = told(answer(health=health_of(before)), answer(health=health_of(condition)))
        assert agent.level("condition_X") == condition.value
        assert len(agent.conditions["condition_X"]) == 1


def test_numbers_are_percent_of_fresh_and_carry_the_time_of_the_measurement() -> None:
    agent = told(answer(preload_percent=3.0, low=2.5, high=4.0, limits=FIVE))
    assert [agent.values[name] for name in NUMBERS[:3]] == [60.0, 50.0, 80.0]
    assert agent.times["preload_X"] == datetime.fromtimestamp(MEASURED_NS / 1e9, UTC)


@pytest.mark.parametrize("status", [s for s in EstimateStatus if s is not EstimateStatus.ESTIMATED])
def test_a_number_that_may_no_longer_be_read_is_unavailable(status: EstimateStatus) -> None:
    without = answer(estimate=PreloadEstimate(time_s=1.0, status=status))
    for now in (without, answer(is_heard=False), SILENT):
        agent = told(answer(), now)
        assert {agent.values[name] for name in NUMBERS} == {"UNAVAILABLE"}
    assert agent.level("condition_X") == agent.level("alarms_X") == "UNAVAILABLE"
    assert agent.values["advice_X"] == ("", "UNAVAILABLE")


@given(st.lists(st.sets(st.sampled_from(list(AlarmKind))), min_size=1, max_size=8))
def test_alarms_come_and_go_one_by_one(course: list[set[AlarmKind]]) -> None:
    alarms = [tuple(alarm_of(each) for each in sorted(now)) for now in course]
    answers = [answer(health=health_of(AxisCondition.FAULT, alarms=each)) for each in alarms]
    levels = told(*answers).conditions["alarms_X"].items()
    active = {code for code, (level, _) in levels if level == "FAULT"}
    assert active == {kind.value for kind in course[-1]}


@given(st.text())
def test_whatever_a_text_holds_it_stays_one_field_on_one_line(text: str) -> None:
    said = mtconnect.field(text.encode("utf-8", "replace").decode())
    assert len(f"a|{said}|b".splitlines()) == 1
    first, middle, last = tokens(f"a|{said}|b")
    assert (first, last) == ("a", "b")
    if text.isascii() and text.isprintable():
        assert middle == text.strip()


async def test_a_foreign_agent_that_connects_is_told_all_and_then_what_changes() -> None:
    async with serving() as adapter, connected(adapter.port, DEVICES) as agent:
        await adapter.take(answer("Y_Z", health=health_of(AxisCondition.WARNING)))
        await until(lambda: "condition_Y_Z" in agent.conditions and agent.seconds > 0.0)
        assert agent.values["avail"] == "AVAILABLE"
        assert (agent.level("condition_X"), agent.level("condition_Y_Z")) == ("NORMAL", "WARNING")
        assert agent.seconds == mtconnect.HEARTBEAT_S <= 1.5  # it knows after twice that
        assert {"* shdrVersion: 2.0", "* mtconnectVersion: 2.0"} < set(agent.commands)
        lost = health_of(AxisCondition.FAULT, alarms=(alarm_of(AlarmKind.PRELOAD_LOST),))
        await adapter.take(answer(health=lost))
        await until(lambda: agent.level("condition_X") == "FAULT")
        async with connected(adapter.port, DEVICES) as late:
            await until(lambda: late.conditions == agent.conditions and late.values == agent.values)


@pytest.mark.parametrize(
    "sent",
    [
        b"",
        b"* PING\n* PI",
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"* PONG 1\n|preload_X|1\n* preload: 1\n",
    ],
)
async def test_half_lines_and_garbage_change_nothing_and_end_with_the_client(sent: bytes) -> None:
    async with serving() as adapter:
        _, writer = await asyncio.open_connection("127.0.0.1", adapter.port)
        writer.write(sent)
        await writer.drain()
        async with connected(adapter.port, DEVICES) as agent:
            await until(lambda: agent.seconds > 0.0)
        writer.close()
        await nobody(adapter)


async def test_who_sends_too_much_is_cut_off() -> None:
    async with serving() as adapter:
        reader, writer = await asyncio.open_connection("127.0.0.1", adapter.port)
        with suppress(ConnectionError):
            writer.write(b"a" * 2000)
            while await reader.read(65_536):
                pass
        await nobody(adapter)
        writer.close()


async def test_who_does_not_read_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "UNREAD_BYTES", 10_000)
    async with serving() as adapter, connected(adapter.port, DEVICES) as agent:
        _, writer = await asyncio.open_connection("127.0.0.1", adapter.port, limit=1)
        await until(lambda: adapter.readings["clients"] == 2)
        count = 0

        async def cut_off() -> bool:
            nonlocal count
            for _ in range(200):
                count += 1
                texts = alarm_of(AlarmKind.RATE, text=f"{count} " + "x" * 5000)
                await adapter.take(answer(health=health_of(AxisCondition.FAULT, alarms=(texts,))))
                await asyncio.sleep(0)
            return adapter.readings["clients"] == 1

        await until(cut_off)
        await until(lambda: agent.conditions["alarms_X"]["rate"][1].startswith(f"{count} "))
        writer.close()


async def test_no_more_clients_than_allowed_and_a_place_is_free_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "CLIENTS", 2)
    async with serving() as adapter:
        first, second = [await asyncio.open_connection("127.0.0.1", adapter.port) for _ in "ab"]
        for reader, _ in (first, second):
            assert (await reader.readline()).startswith(b"* adapterVersion: ")
        for _ in range(20):
            reader, writer = await asyncio.open_connection("127.0.0.1", adapter.port)
            with pytest.raises(ConnectionError):
                assert await reader.read() == b""
                raise ConnectionError
            writer.close()
        assert adapter.readings["clients"] == 2
        second[1].close()
        await until(lambda: adapter.readings["clients"] == 1)
        async with connected(adapter.port, DEVICES) as agent:
            await until(lambda: "avail" in agent.values)
        first[1].close()
