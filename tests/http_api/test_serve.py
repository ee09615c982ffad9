"""Tests of the address that the service listens at, and of the live stream over a socket."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field

import httpx
import pytest

from edge_service.health.store import events
from edge_service.http_api.serve import AddressError, bind
from edge_service.http_api.stream import MOST_READERS, MOST_READERS_OF_ONE

from .conftest import Scene, client_of
from .test_limits import served


@asynccontextmanager
async def _served(scene) -> AsyncIterator[httpx.AsyncClient]:
    async with (
        served(scene) as port,
        httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=5.0) as client,
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
            await _until(lambda: len(scene.state.readers) == 1)
            ids = [scene.hear_event(str(number)) for number in range(2)]
            received = await first
        assert [int(message.id) for message in received] == ids
        await _until(lambda: len(scene.state.readers) == 0)
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
    loop = asyncio.get_running_loop()
    async with _served(scene) as client, client.stream("GET", "/api/v1/events") as response:
        await _until(lambda: len(scene.state.readers) == 1)
        started = loop.time()
        scene.state.readers.close()
        async with asyncio.timeout(60.0):
            await response.aread()
    assert loop.time() - started < 2.0
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
    await asyncio.wait_for(stuck.wait(), 5.0)
    (subscription,) = scene.state.readers._subscriptions
    with scene.state.readers.subscribe() as fast:
        for number in range(2000):
            scene.hear_event(str(number))
            scene.hear_preload()
            await fast.next(1.0)
        assert not (fast.events or fast.changed)
    assert len(subscription.changed) <= 2 * len(scene.state.axes)
    gone.set()
    await asyncio.wait_for(slow, 5.0)
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


async def _until(condition) -> None:
    async with asyncio.timeout(60.0):
        while not condition():
            await asyncio.sleep(0.005)
