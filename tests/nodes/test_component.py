"""A failing axis or output stops alone; another failure ends the process with one line."""

import asyncio
import logging
import socket
from collections.abc import AsyncGenerator
from pathlib import Path
from unittest.mock import AsyncMock

import pytest

from drivers.base import DriverMisconfiguredError, DriverUnavailableError
from drivers.simulated import SimulatedDriver
from edge_service.bus.session import Bus
from edge_service.clock import now_ns
from edge_service.config import ConfigError
from edge_service.health.inputs import Heard
from edge_service.messages.answer import AxisAnswer
from edge_service.messages.codec import Header
from edge_service.messages.health import Command, ComponentStatus, Task
from edge_service.messages.samples import SampleFrame
from edge_service.messages.topics import PRELOAD, RAW, STATUS
from edge_service.nodes import acquire_node, health_node, output_node
from edge_service.nodes.component import Component, PartFailedError
from edge_service.nodes.context import NodeContext
from edge_service.nodes.service import notify_systemd
from edge_service.outputs.mqtt import MqttOutput
from edge_service.retry import Retry

from ..messages.examples import PAYLOADS
from .conftest import PATIENCE_S, config_of, reported, running, two_axes, until

AT_ONCE = Retry(0.0, 0.0)


async def test_a_node_that_fails_ends_the_process_with_its_name_and_the_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(_monitors: health_node.Monitors) -> None:
        raise RuntimeError("on purpose")

    monkeypatch.setattr(health_node.Monitors, "load", fail)
    config = config_of("simulated", {"scenario": "healthy"})
    async with running(config, ("health", "acquire")) as service:
        reports = service.bus.subscribe(config.keys.all_components(STATUS), STATUS, depth=4096)
        with pytest.raises(
            PartFailedError, match=r"^health: RuntimeError: on purpose at test_component\.py:\d+$"
        ):
            await asyncio.wait_for(asyncio.shield(service.task), PATIENCE_S)
        reports.close()
        last = {report.component: report.status async for _, _, report in reports}
    assert set(last.values()) == {ComponentStatus.STOPPED}


async def test_what_a_person_must_mend_is_said_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_monitors: health_node.Monitors) -> None:
        raise ConfigError("axes.X.machine: no such file")

    monkeypatch.setattr(health_node.Monitors, "load", fail)
    async with running(config_of("simulated", {}), ("health",)) as service:
        with pytest.raises(ConfigError, match=r"^axes\.X\.machine: no such file$"):
            await asyncio.wait_for(asyncio.shield(service.task), PATIENCE_S)


async def test_a_driver_that_raises_stops_its_axis_until_it_is_begun_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened: list[str] = []

    class Faulty(SimulatedDriver):
        async def frames(self) -> AsyncGenerator[SampleFrame, None]:
            name = self._context.axis
            opened.append(name)
            async for frame in super().frames():
                if name == "X" and opened.count("X") < 3:
                    raise ZeroDivisionError
                yield frame

    monkeypatch.setattr(acquire_node, "load_driver", lambda _name: Faulty)
    monkeypatch.setattr(acquire_node, "BACKOFF_FIRST_S", 0.0)
    config = two_axes()
    async with running(config, ("acquire",)) as service:
        failed = await reported(service, "acquire", ComponentStatus.RECOVERABLE_ERROR, "X")
        assert failed.reason.startswith("failed (ZeroDivisionError at test_component.py:")
        assert failed.readings["tasks_down"] == 1.0
        mended = await reported(service, "acquire", ComponentStatus.OK, "X")
        assert (mended.counters["task_restarts"], mended.readings["tasks_down"]) == (2, 0.0)
    assert opened.count("Y") == 1


async def test_a_driver_that_is_misconfigured_stops_its_axis_and_names_the_key(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Wrong(SimulatedDriver):
        async def open(self) -> None:
            if self._context.axis == "X":
                raise DriverMisconfiguredError("scenario", "no such file")
            await super().open()

    monkeypatch.setattr(acquire_node, "load_driver", lambda _name: Wrong)
    config = two_axes()
    async with running(config, ("acquire",)) as service:
        samples = service.bus.subscribe(config.keys.all_axes(RAW), RAW)
        wrong = await reported(service, "acquire", ComponentStatus.PERMANENT_ERROR, "X")
        assert wrong.reason == "axes.X.settings.scenario: no such file"
        async with asyncio.timeout(PATIENCE_S):
            assert (await anext(aiter(samples)))[0] == "Y"
        assert not service.task.done()
    async with running(config, ("acquire",), until_sources_end=True) as service:
        with pytest.raises(ConfigError, match=r"settings\.scenario: no such file"):
            await asyncio.wait_for(asyncio.shield(service.task), PATIENCE_S)


async def test_an_output_that_raises_affects_only_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(_output: MqttOutput) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(MqttOutput, "open", fail)
    config = config_of(
        "simulated", {"scenario": "healthy"}, outputs={"mqtt": {"url": "mqtt://127.0.0.1:1"}}
    )
    async with running(config, ("mqtt", "acquire")) as service:
        failed = await reported(service, "mqtt", ComponentStatus.RECOVERABLE_ERROR)
        assert failed.reason.startswith("failed (ZeroDivisionError")
        again = await reported(service, "mqtt", ComponentStatus.RECOVERABLE_ERROR)
        assert again.counters["task_restarts"] >= 1
        await reported(service, "acquire", ComponentStatus.OK, "X")
        assert not service.task.done()


async def test_an_output_has_closed_before_it_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, go_on = [], asyncio.Event()

    async def open_once(output: MqttOutput) -> None:
        if ("open", id(output)) not in seen:
            seen.append(("open", id(output)))

    async def close(output: MqttOutput) -> None:
        await go_on.wait()
        seen.append(("closed", id(output)))

    async def take(_output: MqttOutput, _message: object) -> None:
        pass

    for name, work in (("open", open_once), ("close", close), ("take", take)):
        monkeypatch.setattr(MqttOutput, name, work)
    config = two_axes(outputs={"mqtt": {"url": "mqtt://127.0.0.1:1"}})
    async with running(config, ("mqtt", "acquire")) as service:
        await until(lambda: len(seen) == 1)
        context, axis = service.context, config.axes[1]
        machine = context.machines["Y"]
        context.drop("Y")
        await asyncio.sleep(0)
        context.renew(axis, machine)
        for _ in range(100):
            await asyncio.sleep(0)
        assert len(seen) == 1
        go_on.set()
        await until(lambda: len(seen) == 3)
        assert [what for what, _ in seen] == ["open", "closed", "open"]
        assert seen[0][1] == seen[1][1]


async def test_all_axes_are_told_at_once_and_the_one_told_longest_ago_is_the_age(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A round trip is as long with many axes; an axis that is not told is not hidden by others."""
    pair = asyncio.Barrier(2)

    async def take(_output: MqttOutput, message: AxisAnswer) -> None:
        await pair.wait()
        if message.axis == "Y":
            await asyncio.Event().wait()

    for name, value in (("open", AsyncMock()), ("take", take), ("receivers", ())):
        monkeypatch.setattr(MqttOutput, name, value)
    monkeypatch.setattr(output_node, "TAKE_S", 0.2)
    monkeypatch.setattr(output_node, "new_retry", lambda: AT_ONCE)
    config = two_axes(outputs={"mqtt": {"url": "mqtt://127.0.0.1:1"}})
    async with running(config, ("mqtt",)) as service:
        reports = service.bus.subscribe(config.keys.all_components(STATUS), STATUS, depth=4096)
        async for _, _, each in reports:
            if each.component == "mqtt" and each.counters["sent"] > 4:
                assert each.readings["age_s"] > 0.2 * 4
                break


@pytest.mark.parametrize("opens", [True, False])
async def test_who_was_held_up_hears_the_newest_and_nothing_of_what_was_between(
    opens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told, heard, go_on = [], [], asyncio.Event()
    hear, begun = Heard.hear, AsyncMock(side_effect=None if opens else go_on.wait)

    async def take(_output: MqttOutput, message: AxisAnswer) -> None:
        told.append(message.header and message.header.sequence)
        await go_on.wait()

    def note(self: Heard[object], header: Header, payload: object, at_ns: int) -> None:
        hear(self, header, payload, at_ns)
        heard.append(header.sequence)

    for name, value in (("open", begun), ("take", take), ("receivers", ())):
        monkeypatch.setattr(MqttOutput, name, value)
    monkeypatch.setattr(Heard, "hear", note)
    config = config_of("simulated", {}, outputs={"mqtt": {"url": "mqtt://127.0.0.1:1"}})
    async with running(config, ("mqtt",)) as service:
        await until(lambda: told or begun.called)
        preload = service.context.publishers(PRELOAD)["X"]
        for _ in range(50):
            preload.publish(PAYLOADS["preload"], now_ns())
        await until(lambda: len(heard) == 50)
        go_on.set()
        await until(lambda: heard[-1] in told)
        assert told[: told.index(heard[-1])] == [None] * opens


async def test_an_output_says_that_the_service_is_starting(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[AxisAnswer] = []
    take = AsyncMock(side_effect=told.append)
    for name, value in (("open", AsyncMock()), ("take", take), ("receivers", ())):
        monkeypatch.setattr(MqttOutput, name, value)
    config = config_of("simulated", {}, outputs={"mqtt": {"url": "mqtt://127.0.0.1:1"}})
    async with running(config, ("mqtt",)) as service:
        await until(lambda: told and told[-1].health.advice[0].task is Task.SWITCH_ON)
        Component(service.context, "estimate", "X").to(ComponentStatus.STARTING, "compiling")
        await until(lambda: told[-1].health.advice[0].task is Task.WAIT)


async def test_an_axis_that_comes_back_goes_on_where_it_was(bus: Bus) -> None:
    config = two_axes()
    context = NodeContext(config, bus)
    monitors, machine = health_node.Monitors(context), context.machines["Y"]
    monitors.load()
    shelved = Command(action="shelve", alarm="rate", user="Kim", duration_s=3600.0)
    monitors.axes["Y"].obey(shelved, 1)
    kept = monitors.axes["Y"].snapshot() | {"saved_ns": 0}
    context.drop("Y")
    assert set(monitors.axes) == {"X"}
    await monitors.foresee("Y")
    context.renew(config.axes[1], machine)
    assert monitors.axes["Y"].snapshot() | {"saved_ns": 0} == kept


async def test_a_message_that_cannot_be_handled_is_counted_and_told_once_a_minute(
    bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    config, taken = two_axes(), []

    def take(axis: str, *_: object) -> None:
        if axis == "X":
            raise ValueError("no number")
        taken.append(axis)

    context = NodeContext(config, bus)
    component, other = Component(context, "part"), Component(context, "other")
    key = config.keys.component("part", None, STATUS)
    reports = bus.subscribe(key, STATUS, keys=(key,))
    with caplog.at_level(logging.WARNING):
        async with component.running():
            component.to(ComponentStatus.OK)
            component.follow(context.subscribe(RAW), take)
            publishers = context.publishers(RAW)
            for axis in ("X", "X", "X", "Y"):
                publishers[axis].publish(PAYLOADS["raw"], 1)
            await until(lambda: taken == ["Y"])
            component.publish()
    reports.close()
    seen = [report async for _, _, report in reports]
    assert other.status is ComponentStatus.STARTING
    assert len([line for line in caplog.messages if "no number" in line]) == 1
    told = next(each for each in seen if each.counters["message_failures"] == 3)
    assert told.status is ComponentStatus.RECOVERABLE_ERROR
    assert "cannot handle a message of axis X: ValueError: no number" in told.reason


async def test_what_is_away_is_tried_again_and_said_once(
    bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    tries = []

    async def work() -> None:
        tries.append(1)
        if len(tries) < 4:
            raise DriverUnavailableError("no answer")
        if len(tries) == 4:
            raise DriverMisconfiguredError("url", "wrong")

    component = Component(NodeContext(two_axes(), bus), "part")
    with pytest.raises(DriverMisconfiguredError), caplog.at_level(logging.WARNING):
        await component.again(work, AT_ONCE, DriverUnavailableError, DriverMisconfiguredError)
    await component.again(work, AT_ONCE, DriverUnavailableError)
    assert (len(tries), component.restarts) == (5, 3)
    assert caplog.messages == ["part: no answer; trying again"]


async def test_work_that_fails_while_it_is_ended_is_not_begun_anew(bus: Bus) -> None:
    tries = []

    async def work() -> None:
        tries.append(1)
        try:
            await asyncio.Event().wait()
        finally:
            raise DriverUnavailableError("gone while it closed")

    component = Component(NodeContext(two_axes(), bus), "part")
    task = asyncio.create_task(component.again(work, AT_ONCE, DriverUnavailableError))
    await until(lambda: tries)
    task.cancel()
    await asyncio.wait_for(asyncio.wait({task}), PATIENCE_S)
    assert (task.cancelled(), len(tries)) == (True, 1)


def listener(address: str | bytes) -> socket.socket:
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(address)
    heard.setblocking(False)
    return heard


@pytest.mark.parametrize("is_abstract", [False, True])
def test_systemd_hears_where_it_asks_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_abstract: bool
) -> None:
    name = f"edge-service-{tmp_path.name}-{id(tmp_path)}"
    address = f"@{name}" if is_abstract else str(tmp_path / "notify")
    with listener(f"\0{name}" if is_abstract else address) as heard:
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        notify_systemd("READY=1")
        assert heard.recv(4096) == b"READY=1"
    for nowhere in ("nowhere", str(tmp_path / "not" / "there")):
        monkeypatch.setenv("NOTIFY_SOCKET", nowhere)
        notify_systemd("READY=1")


async def test_a_service_is_ready_when_it_serves_and_feeds_the_watchdog_over_the_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    with listener(str(tmp_path / "notify")) as heard:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))

        def all_heard() -> bool:
            while True:
                try:
                    said.append(heard.recv(4096).decode())
                except BlockingIOError:
                    return {"READY=1", "WATCHDOG=1"} <= set(said)

        config = config_of("simulated", {"scenario": "healthy"})
        async with running(config, ("http", "health")) as service:
            await asyncio.wait_for(service.address, PATIENCE_S)
            await until(all_heard)
        all_heard()
    assert said[-1] == "STOPPING=1"
