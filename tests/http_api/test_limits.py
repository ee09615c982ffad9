"""Requests that are too long, or none."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import httpx
import pytest

from edge_service.http_api import guard, serve
from edge_service.http_api.app import create_app
from edge_service.http_api.routes.docs import static_digest

HOST = b"Host: 127.0.0.1\r\n"
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
            before_stop=scene.state.close,
        )
    )
    try:
        await asyncio.wait({task, bound}, return_when=asyncio.FIRST_COMPLETED)
        yield bound.result()
    finally:
        task.cancel()
        await asyncio.wait({task}, timeout=10.0)


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (POST + b"Content-Length: 100000000\r\n\r\n" + b"x" * 100_000, b"413"),
        (b"GET /" + b"a" * 30_000, b"400"),
        (b"\x16\x03\x01" + b"\0" * 100 + b"\r\n\r\n", b"400"),
    ],
)
async def test_what_is_too_long_or_no_request_is_refused(scene, sent: bytes, status: bytes) -> None:
    async with served(scene) as port:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(sent)
        answer = await asyncio.wait_for(reader.read(4096), 10.0)
        writer.close()
        with suppress(ConnectionError):
            await writer.wait_closed()
    assert answer[9:12] == status
    assert (b"application/problem+json" in answer) == (status == b"413")


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
    await asyncio.wait_for(app(scope, receive, send), 10.0)
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
    scene.state.close()
    assert (await client.head("/api/v1/events")).status_code == 200
