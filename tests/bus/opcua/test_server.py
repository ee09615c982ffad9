"""The server as clients see it that know the companion specifications only."""

import asyncio
import json
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from asyncua import Client, ua

from edge_service.bus.opcua.application import OpcuaSettings
from edge_service.bus.opcua.server import AnswerServer
from edge_service.messages.answer import AxisAnswer
from edge_service.messages.health import AxisCondition

from ...messages.answers import MEASURED_NS, SILENT, answer, health_of

FOREIGN = Path(__file__).parent / "foreign_client.py"
PATIENCE_S = 60.0


@asynccontextmanager
async def serving(
    settings: OpcuaSettings, *answers: AxisAnswer
) -> AsyncIterator[tuple[AnswerServer, str]]:
    server = await asyncio.to_thread(AnswerServer.built, settings, answers)
    await server.start()
    try:
        yield server, f"opc.tcp://127.0.0.1:{server.port}/edge-service/"
    finally:
        await server.stop()


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


async def test_a_foreign_process_finds_all_by_type_hears_changes_and_changes_nothing() -> None:
    worn = answer(
        "Y", preload_percent=1.0, low=0.5, high=1.5, health=health_of(AxisCondition.FAULT)
    )
    settings = OpcuaSettings("127.0.0.1", 0, "hall/mill", sessions=2)
    async with serving(settings, answer("X"), worn) as (server, url), foreign(url) as process:
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
        await server.show([answer("X", health=health_of(AxisCondition.WARNING)), worn])
        assert await line_of(process) == {"health": 4, "status": "Good"}
        await server.show([SILENT, worn])
        assert await line_of(process) == {"health": None, "status": "BadNoCommunication"}

        async with Client(url):
            assert server.sessions == 2
            with pytest.raises(ua.UaStatusCodeError) as caught:
                await Client(url).connect()
            assert caught.value.code == ua.StatusCodes.BadTooManySessions


async def test_who_leaves_unread_or_sends_without_end_is_cut_off() -> None:
    settings = OpcuaSettings("127.0.0.1", 0, "m", sessions=2)
    async with serving(settings, answer()) as (server, _):
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


async def test_a_start_that_is_cancelled_when_it_listens_leaves_no_socket(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server = await asyncio.to_thread(
        AnswerServer.built, OpcuaSettings("127.0.0.1", 0, "m", sessions=2), [answer()]
    )
    starting = asyncio.ensure_future(server.start())
    listening: list[socket.socket] = []
    begin = asyncio.Server._start_serving  # type: ignore[attr-defined]

    def cancelled(self: asyncio.Server) -> None:
        begin(self)
        listening.extend(self._sockets)  # type: ignore[attr-defined]
        starting.cancel()

    monkeypatch.setattr(asyncio.Server, "_start_serving", cancelled)
    with pytest.raises(asyncio.CancelledError):
        await starting
    await server.stop()
    assert [each.fileno() for each in listening] == [-1]
