"""Clients that are slow, silent, too many or too long: each is let go, and holds up no other."""

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest

from edge_service.health.store import events
from edge_service.http_api import guard, serve
from edge_service.http_api.app import create_app, static_digest
from edge_service.http_api.serve import AddressError, bind
from edge_service.http_api.stream import MOST_READERS, MOST_READERS_OF_ONE

from ..nodes.conftest import until
from .conftest import Scene, client_of

HOST = b"Host: 127.0.0.1\r\n"
ALIVE = b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n"
STREAM = b"GET /api/v1/events HTTP/1.1\r\n" + HOST + b"\r\n"
POST = b"POST /api/v1/axes/X/commands HTTP/1.1\r\ncontent-type: application/json\r\n" + HOST


@asynccontextmanager
async def served(scene, **parts) -> AsyncIterator[int]:
    """The scene's state over a socket; the port."""
    app = create_app(scene.state, lambda: scene.now_ns, **parts)
    bound = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(
        serve.serve(
            app,
            "127.0.0.1",
            0,
            on_bound=lambda _host, port: bound.set_result(port),
            before_stop=scene.state.readers.close,
        )
    )
    try:
        await asyncio.wait({task, bound}, return_when=asyncio.FIRST_COMPLETED)
        yield bound.result()
    finally:
        task.cancel()
        await asyncio.wait({task}, timeout=60.0)


class RawClient:
    """One connection whose client need not keep to HTTP."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    def send(self, raw: bytes) -> None:
        self._writer.write(raw)

    async def answer(self) -> bytes:
        """Whatever comes until the service ends the connection."""
        try:
            return await asyncio.wait_for(self._reader.read(), 60.0)
        except ConnectionError:
            return b""

    async def some(self) -> bytes:
        return await asyncio.wait_for(self._reader.read(4096), 60.0)

    async def close(self) -> None:
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()


@asynccontextmanager
async def connected(port: int) -> AsyncIterator[RawClient]:
    client = RawClient(*await asyncio.open_connection("127.0.0.1", port))
    try:
        yield client
    finally:
        await client.close()


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"", b""),
        (b"GET /healthz HTTP/1.1\r\n" + HOST, b""),
        (POST + b"Content-Length: 10\r\n\r\n{", b"408"),
        (POST + b"Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n", b"408"),
        (POST + b"Content-Length: 100000000\r\n\r\n" + b"x" * 100_000, b"413"),
        (b"GET /" + b"a" * 30_000, b"400"),
        (b"\x16\x03\x01" + b"\0" * 100 + b"\r\n\r\n", b"400"),
    ],
)
async def test_who_does_not_go_on_is_let_go(scene, monkeypatch, sent: bytes, status: bytes) -> None:
    if not status:
        monkeypatch.setattr(serve, "HEAD_S", 0.05)
    monkeypatch.setattr(guard, "BODY_IDLE_S", 0.05)
    async with served(scene) as port, connected(port) as client:
        client.send(sent)
        answer = await client.some()
    assert answer[9:12] == status
    assert (b"application/problem+json" in answer) == (status in (b"408", b"413"))


async def test_bytes_that_trickle_do_not_extend_the_time_of_a_head(scene, monkeypatch) -> None:
    monkeypatch.setattr(serve, "HEAD_S", 0.05)
    async with served(scene) as port, connected(port) as client:
        client.send(b"GET /healthz HTTP/1.1\r\n")

        async def trickle() -> None:
            while True:
                client.send(b"a:b\r\n")
                await asyncio.sleep(0.005)

        trickling = asyncio.create_task(trickle())
        assert await client.answer() == b""
        trickling.cancel()


async def test_connections_beyond_their_number_are_dropped_until_one_leaves(
    scene, monkeypatch
) -> None:
    monkeypatch.setattr(serve, "MOST_CONNECTIONS", 3)
    async with served(scene) as port, AsyncExitStack() as crowd:
        silent = [await crowd.enter_async_context(connected(port)) for _ in range(10)]
        assert all([await each.answer() == b"" for each in silent[3:]])
        for each in silent:
            await each.close()
        async with asyncio.timeout(60.0):
            status = b""
            while status != b"200":
                async with connected(port) as client:
                    client.send(ALIVE)
                    status = (await (client.answer() if status else client.some()))[9:12]


async def test_a_reader_that_does_not_read_loses_its_place(scene, monkeypatch) -> None:
    """The system itself drops it, once its buffers are full."""
    monkeypatch.setattr(serve, "STALLED_S", 0.2)
    async with served(scene) as port:
        with socket.socket() as silent:
            silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            silent.setblocking(False)
            await asyncio.get_running_loop().sock_connect(silent, ("127.0.0.1", port))
            silent.send(STREAM)
            await until(lambda: len(scene.state.readers) == 1)
            async with asyncio.timeout(60.0):
                while len(scene.state.readers) > 0:
                    scene.hear_event("x" * 1000)
                    await asyncio.sleep(0.001)


CHUNK = b"[" * 10_000


async def asked(
    app: Callable[..., Awaitable[None]], method: str, path: str, *headers: tuple[bytes, bytes]
) -> tuple[int, int]:
    """Status of a request whose body has no end, and how many bytes of it were read."""
    sent, messages = 0, []

    async def receive() -> dict[str, Any]:
        nonlocal sent
        sent += len(CHUNK)
        return {"type": "http.request", "body": CHUNK, "more_body": True}

    async def send(message: dict[str, Any]) -> None:
        messages.append(message)

    scope = {
        "type": "http", "method": method, "path": path, "raw_path": path.encode(),
        "query_string": b"", "headers": [(b"host", b"127.0.0.1"), *headers], "asgi": {},
        "http_version": "1.1", "scheme": "http", "root_path": "",
    }  # fmt: skip
    await asyncio.wait_for(app(scope, receive, send), 60.0)
    return messages[0]["status"], sent


FILLED = {"axis": "X", "name": "a.csv", "id": 1, "output": "mqtt"}
KINDS = [b"application/json", b"text/csv"]


@pytest.mark.parametrize("kind", KINDS)
async def test_no_route_reads_a_body_without_end(scene, monkeypatch, kind: bytes) -> None:
    monkeypatch.setattr(guard, "RECORDING_BYTES", 100_000)
    for path, methods in scene.app.openapi()["paths"].items():
        for method in methods:
            if path == "/api/v1/events":
                continue
            chunked = ((b"content-type", kind), (b"transfer-encoding", b"chunked"))
            place = path.format(**FILLED)
            _, read = await asked(scene.app, method.upper(), place, *chunked)
            assert read <= 100_000 + len(CHUNK), (method, path)
            long = ((b"content-type", kind), (b"content-length", b"600000000"))
            assert await asked(scene.app, method.upper(), place, *long) == (413, 0), (method, path)


async def test_head_is_get_without_its_body(scene, client: httpx.AsyncClient) -> None:
    scene.hear_all()
    for path in (
        "/",
        "/healthz",
        "/metrics",
        "/api/v1/axes/X/preload",
        f"/static/{static_digest()}/app.js",
    ):
        got, head = await client.get(path), await client.head(path)
        assert (head.status_code, head.content) == (got.status_code, b"")
        assert head.headers["content-type"] == got.headers["content-type"]
    scene.state.readers.close()
    assert (await client.head("/api/v1/events")).status_code == 200


@asynccontextmanager
async def _served(scene) -> AsyncIterator[httpx.AsyncClient]:
    async with (
        served(scene) as port,
        httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=60.0) as client,
    ):
        yield client


@dataclass
class Message:
    event: str = "message"
    data: str = ""
    id: str | None = None
    fields: list[str] = field(default_factory=list)


async def _messages(response: httpx.Response) -> AsyncIterator[Message]:
    message = Message()
    async for line in response.aiter_lines():
        if not line:
            yield message
            message = Message()
            continue
        name, _, value = line.partition(":")
        message.fields.append(name)
        if name in ("event", "data", "id"):
            setattr(message, name, value.removeprefix(" "))


async def _read(response: httpx.Response, count: int) -> list[Message]:
    messages = []
    async with asyncio.timeout(60.0):
        async for message in _messages(response):
            if message.event == "event":
                messages.append(message)
            if len(messages) == count:
                break
    return messages


async def test_stream_begins_with_retry_and_the_newest_values(scene):
    scene.hear_all()
    seen = []
    async with _served(scene) as client, client.stream("GET", "/api/v1/events") as response:
        assert response.headers["content-type"].startswith("text/event-stream")
        async with asyncio.timeout(60.0):
            async for message in _messages(response):
                seen.append(message)
                if len(seen) == 7:
                    break
    assert "retry" in seen[0].fields
    assert seen[1].fields == [""]  # a comment keeps the connection alive
    names = [message.event for message in seen[2:]]
    assert names == ["service", "preload", "health", "preload", "health"]
    assert '"preload_percent":6.71' in seen[3].data


async def test_stream_is_resumed_where_it_broke_off(scene):
    async with _served(scene) as client:
        async with client.stream("GET", "/api/v1/events") as response:
            first = asyncio.create_task(_read(response, 2))
            await until(lambda: len(scene.state.readers) == 1)
            ids = [scene.hear_event(str(number)) for number in range(2)]
            received = await first
        assert [int(message.id) for message in received] == ids
        await until(lambda: len(scene.state.readers) == 0)
        missed = [scene.hear_event(f"missed {number}") for number in range(3)]
        headers = {"Last-Event-ID": str(ids[-1])}
        async with client.stream("GET", "/api/v1/events", headers=headers) as response:
            received = await _read(response, 3)
        assert [int(message.id) for message in received] == missed
        assert "missed 0" in received[0].data


async def test_reader_that_was_away_too_long_is_told(monkeypatch):
    monkeypatch.setattr(events, "MOST_KEPT", 40)  # a 20th in memory
    scene = Scene()
    first = scene.hear_event("seen")
    for number in range(60):
        scene.hear_event(str(number))
    url = f"/api/v1/events?last_event_id={first}"
    async with _served(scene) as client, client.stream("GET", url) as response:
        messages = []
        async with asyncio.timeout(60.0):
            async for message in _messages(response):
                messages.append(message)
                if len(messages) == 4:
                    break
    assert [message.event for message in messages[1:]] == ["lost", "event", "event"]
    assert '"count": null' in messages[1].data


async def test_stream_of_one_axis(scene):
    scene.hear_event("of X", axis="X")
    scene.hear_event("of Y", axis="Y")
    scene.hear_event("of the service", axis="")
    url = "/api/v1/events?axis=Y&last_event_id=0"
    async with _served(scene) as client, client.stream("GET", url) as response:
        received = await _read(response, 2)
    assert ["of Y" in received[0].data, "of the service" in received[1].data] == [True, True]


async def test_open_streams_do_not_hold_up_the_end(scene):
    async with _served(scene) as client, client.stream("GET", "/api/v1/events") as response:
        await until(lambda: len(scene.state.readers) == 1)
        scene.state.readers.close()
        async with asyncio.timeout(60.0):
            await response.aread()
    assert len(scene.state.readers) == 0


async def test_slow_client_cannot_fill_the_service_nor_hold_up_another(scene):
    scope = {
        "type": "http", "method": "GET", "path": "/api/v1/events", "raw_path": b"/api/v1/events",
        "query_string": b"", "headers": [(b"host", b"127.0.0.1")], "asgi": {"spec_version": "2.3"},
        "http_version": "1.1", "scheme": "http", "root_path": "",
    }  # fmt: skip
    gone = asyncio.Event()
    stuck = asyncio.Event()

    async def receive():
        await gone.wait()
        return {"type": "http.disconnect"}

    async def send(message):
        if message["type"] == "http.response.body":
            stuck.set()
            await gone.wait()

    slow = asyncio.create_task(scene.app(scope, receive, send))
    await asyncio.wait_for(stuck.wait(), 60.0)
    (subscription,) = scene.state.readers._subscriptions
    with scene.state.readers.subscribe() as fast:
        for number in range(2000):
            scene.hear_event(str(number))
            scene.hear_preload()
            await fast.next(1.0)
        assert not (fast.events or fast.changed)
    assert len(subscription.changed) <= 2 * len(scene.state.axes)
    gone.set()
    await asyncio.wait_for(slow, 60.0)
    assert len(scene.state.readers) == 0


async def test_readers_are_bounded_and_those_of_one_address_unless_it_is_loopback(scene):
    for address, status in (("192.0.2.1", 429), ("127.0.0.1", 503)):
        scene.app.state.readers_of[address] = MOST_READERS_OF_ONE
        with ExitStack() as held:
            for _ in range(MOST_READERS):
                held.enter_context(scene.state.readers.subscribe())
            async with client_of(scene.app, client=(address, 1)) as one:
                assert (await one.get("/api/v1/events")).status_code == status
        assert scene.app.state.readers_of[address] == MOST_READERS_OF_ONE


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "10.0.0.1"])
def test_only_loopback_addresses_are_allowed(host):
    with pytest.raises(AddressError, match="only loopback addresses are served without TLS"):
        bind(host, 0)


@pytest.mark.parametrize(("host", "port"), [("machine", 0), ("", 0), ("127.0.0.1", 70000)])
def test_addresses_that_make_no_sense_are_refused(host, port):
    with pytest.raises(AddressError, match="expected"):
        bind(host, port)


async def test_cancelled_service_frees_its_port(scene):
    async with served(scene) as port:
        pass
    bind("127.0.0.1", port).close()
