"""Bodies on every route of the description: bounded before anything reads them."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app
from edge_service.http_api.limits.settings import HttpLimits

LIMITS = HttpLimits(json_bytes=1000, upload_bytes=5000, body_idle_s=0.02, body_s=0.05)
CHUNK = b"[" * 100


def operations() -> list[tuple[str, str]]:
    """Method and path of everything that the description lists, and methods that it does not."""
    paths = create_app(ServiceState({"X": None}, 0), lambda: 0).openapi()["paths"]
    methods = ("GET", "POST", "PUT", "DELETE", "PATCH")
    return [(method, path) for path in [*paths, "/", "/nothing"] for method in methods]


class _Sender:
    """A client that sends chunks without end, or stops after some."""

    def __init__(self, chunks: int | None) -> None:
        self._left, self.sent, self.messages = chunks, 0, []

    async def receive(self) -> dict:
        if self._left == 0:
            await asyncio.Event().wait()
        self._left = None if self._left is None else self._left - 1
        self.sent += len(CHUNK)
        return {"type": "http.request", "body": CHUNK, "more_body": True}

    async def send(self, message: dict) -> None:
        self.messages.append(message)

    @property
    def status(self) -> int:
        return self.messages[0]["status"]


async def _ask(app, chunks, method, path, headers) -> _Sender:
    sender = _Sender(chunks)
    path = path.format(
        axis="X", name="a.csv", number=1, form="parquet", output="webhook", letter="1"
    )
    scope = {
        "type": "http", "method": method, "path": path, "raw_path": path.encode(),
        "query_string": b"", "headers": [(b"host", b"127.0.0.1"), *headers], "asgi": {},
        "http_version": "1.1", "scheme": "http", "root_path": "",
    }  # fmt: skip
    await asyncio.wait_for(app(scope, sender.receive, sender.send), 5.0)
    return sender


async def _ask_all(scene, chunks, *headers) -> AsyncIterator[tuple[str, _Sender]]:
    app = create_app(scene.state, lambda: scene.now_ns, limits=LIMITS)
    asked = [(method, path) for method, path in operations()]
    senders = await asyncio.gather(*(_ask(app, chunks, *each, headers) for each in asked))
    for (method, path), sender in zip(asked, senders, strict=True):
        yield f"{method} {path}", sender


KINDS = [(), (b"content-type", b"application/json"), (b"content-type", b"text/csv")]
BY_GATE = (404, 405)
"""Paths and methods that are none are refused before any body is looked at."""
NO_DESK = (*BY_GATE, 503)
"""A recording is refused by its route, or by the desk that is not there, without being read."""


@pytest.mark.parametrize("kind", KINDS)
async def test_a_body_that_says_it_is_too_long_is_not_read(scene, kind):
    headers = [each for each in (kind, (b"content-length", b"600000000")) if each]
    async for asked, sender in _ask_all(scene, None, *headers):
        assert sender.status in (413, *BY_GATE), asked
        assert sender.sent == 0, asked


@pytest.mark.parametrize("kind", KINDS)
async def test_a_body_without_end_is_cut_off(scene, kind):
    headers = [each for each in (kind, (b"transfer-encoding", b"chunked")) if each]
    async for asked, sender in _ask_all(scene, None, *headers):
        assert sender.status in (413, *NO_DESK), asked
        assert sender.sent <= LIMITS.json_bytes + len(CHUNK), asked


@pytest.mark.parametrize("kind", KINDS)
async def test_a_body_that_stops_is_waited_for_no_longer_than_agreed(scene, kind):
    headers = [each for each in (kind, (b"content-length", b"900")) if each]
    async for asked, sender in _ask_all(scene, 2, *headers):
        assert sender.status in (408, *NO_DESK), asked
