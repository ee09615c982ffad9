"""The server as clients see it that know the companion specifications only."""

import asyncio
import gc
import json
import math
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from asyncua import Client, ua

from edge_service.messages.answer import AxisAnswer
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import Limits
from edge_service.outputs import opcua as module
from edge_service.outputs.base import OutputContext
from edge_service.outputs.opcua import OpcuaConfig, OpcuaOutput
from edge_service.outputs.opcua_nodes import FIELDS, HEALTH, data_values

from ...messages.answers import MEASURED_NS, SILENT, answer, health_of

FOREIGN = Path(__file__).parent / "foreign_client.py"
PATIENCE_S, STALE = 60.0, "UncertainLastUsableValue"
FIVE = Limits(fresh_percent=5.0, warning_percent=3.0, fault_percent=1.5)


@asynccontextmanager
async def serving(*answers: AxisAnswer) -> AsyncIterator[tuple[OpcuaOutput, str]]:
    axes = tuple(each.axis for each in answers)
    context = OutputContext("opcua", "hall", "mill", axes)
    output = OpcuaOutput(OpcuaConfig(endpoint="opc.tcp://127.0.0.1:0"), context)
    await output.open()
    for each in answers:
        await output.take(each)
    try:
        yield output, f"opc.tcp://127.0.0.1:{output.port}/edge-service/"
    finally:
        await output.close()


@asynccontextmanager
async def foreign(url: str) -> AsyncIterator[asyncio.subprocess.Process]:
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(FOREIGN), url, "changes", stdin=pipe, stdout=pipe, limit=10**6
    )
    try:
        yield process
    finally:
        assert process.stdin is not None
        process.stdin.close()
        async with asyncio.timeout(PATIENCE_S):
            assert await process.wait() == 0


async def line_of(process: asyncio.subprocess.Process) -> dict:
    assert process.stdout is not None
    async with asyncio.timeout(PATIENCE_S):
        return json.loads(await process.stdout.readline())


@pytest.mark.slow
@pytest.mark.smoke
async def test_a_foreign_process_finds_all_by_type_hears_changes_and_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "SESSIONS", 2)
    monkeypatch.setattr(module, "OLD_S", math.inf)
    bad = answer("Y", preload_percent=1.0, low=0.5, high=1.5, health=health_of(AxisCondition.FAULT))
    async with serving(answer("X"), bad) as (server, url), foreign(url) as process:
        found = await line_of(process)
        assert found["machine"] == ["hall/mill"]
        assert found["health"] == {"X": [0, "Good"], "Y": [1, "Good"]}
        fresh, y = ([100.0, 30.0], found["lifetime"])
        assert y == [
            [pytest.approx(6.7 / 0.0685), "Good", *fresh],
            [pytest.approx(1.0 / 0.0685), "Good", *fresh],
        ]
        assert found["prognosis"]["X"] == ["", "Good", "None", "BadNoDataAvailable"]
        text, good, due, _ = found["prognosis"]["Y"]
        assert text.startswith("Replace or readjust the nut")
        assert (good, due[:19]) == ("Good", "2026-09-21 14:13:20")
        assert MEASURED_NS == 1_790_000_000_000_000_000  # 2026-09-21T14:13:20Z
        assert found["writes_refused"]
        heard = sorted([(await line_of(process))["health"] for _ in range(2)])
        assert heard == [0, 1]
        await server.take(answer("X", health=health_of(AxisCondition.WARNING)))
        assert await line_of(process) == {"health": 4, "status": "Good"}
        await server.take(SILENT)
        assert await line_of(process) == {"health": None, "status": "BadNoCommunication"}

        async with Client(url) as client:
            assert server.readings == {"sessions": 2.0}
            with pytest.raises(ua.UaStatusCodeError) as caught:
                await Client(url).connect()
            assert caught.value.code == ua.StatusCodes.BadTooManySessions
            await server.take(answer())
            number = client.get_node(server._space.shown["X"]["Preload"][0])
            assert await number.read_value() == pytest.approx(6.7 / 0.0685)
            monkeypatch.setattr(module, "OLD_S", 0.0)  # a stall until this reading
            assert (await number.read_data_value(False)).StatusCode.name == STALE


@pytest.mark.slow
async def test_who_leaves_unread_or_sends_without_end_is_cut_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "SESSIONS", 2)
    async with serving(answer()) as (server, _):
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"MSGF" + (2**31).to_bytes(4, "little"))
        with pytest.raises(ConnectionError):
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    writer.write(bytes(100_000))
                    await writer.drain()
        writer.close()
        idle = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(4)]
        more = await asyncio.open_connection("127.0.0.1", server.port)
        async with asyncio.timeout(PATIENCE_S):
            assert await more[0].read() == b""  # refused beyond twice the sessions
        more[1].close()
        for each in idle:
            each.close()
        reader.feed_eof()


NUMBERS = ("Preload", "PreloadLow", "PreloadHigh")


@pytest.mark.slow
async def test_a_server_that_is_closed_stays_in_no_memory() -> None:
    gc.disable()
    async with serving(answer()) as (output, _):
        one = sum(type(each).__name__ == "NodeData" for each in gc.get_objects())
        await output.close()
        await output.open()
        assert sum(type(each).__name__ == "NodeData" for each in gc.get_objects()) == one
    gc.enable()


def test_a_number_is_percent_of_fresh_with_its_interval_and_time() -> None:
    values = data_values(answer(preload_percent=3.0, low=2.5, high=4.0, limits=FIVE))
    assert [values[name].Value.Value for name in NUMBERS] == pytest.approx([60, 50, 80])
    for name in NUMBERS:
        assert values[name].StatusCode.is_good()
        assert values[name].SourceTimestamp.timestamp() == pytest.approx(1_790_000_000.0)


@pytest.mark.parametrize("status", [s for s in EstimateStatus if s is not EstimateStatus.ESTIMATED])
def test_without_a_number_each_is_null_and_bad(status: EstimateStatus) -> None:
    values = data_values(answer(estimate=PreloadEstimate(time_s=1.0, status=status)))
    for name in NUMBERS:
        assert values[name].Value.Value is None
        assert values[name].StatusCode.is_bad()
    assert values["Status"].Value.Value == status.value


def test_every_variable_has_a_value_or_a_bad_status() -> None:
    for said in (answer(), answer(limits=None), SILENT):
        values = data_values(said)
        assert values.keys() == FIELDS.keys()
        for value in values.values():
            assert (value.Value.Value is None) == value.StatusCode.is_bad()
    for name in (*NUMBERS, HEALTH):
        assert data_values(SILENT)[name].StatusCode.name == "BadNoCommunication"
