"""Clients that speak TCP, and need not keep to HTTP; the service as they find it."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from edge_service.http_api.app import create_app
from edge_service.http_api.limits.settings import HttpLimits
from edge_service.http_api.serve import serve

HOST = b"Host: 127.0.0.1\r\n"


@asynccontextmanager
async def served(scene, limits: HttpLimits, desk=None, tls=None) -> AsyncIterator[int]:
    """The scene's state over a socket; the port."""
    app = create_app(scene.state, lambda: scene.now_ns, desk=desk, limits=limits)
    stop, bound = asyncio.Event(), asyncio.get_running_loop().create_future()
    task = asyncio.create_task(
        serve(
            app,
            "127.0.0.1",
            0,
            stop=stop,
            on_bound=lambda _host, port: bound.set_result(port),
            before_stop=scene.state.close,
            limits=limits,
            tls=tls,
        )
    )
    try:
        yield await bound
    finally:
        stop.set()
        await asyncio.wait_for(task, 5.0)


class RawClient:
    """One connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    def send(self, raw: bytes) -> None:
        """Send bytes as they are."""
        self._writer.write(raw)

    async def answer(self) -> bytes:
        """Whatever comes until the service ends the connection."""
        try:
            return await asyncio.wait_for(self._reader.read(), 5.0)
        except ConnectionError:
            return b""

    async def some(self) -> bytes:
        """Bytes that come next."""
        return await asyncio.wait_for(self._reader.read(4096), 5.0)

    async def close(self) -> None:
        """Leave."""
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()


@asynccontextmanager
async def connected(port: int, limit: int = 2**16) -> AsyncIterator[RawClient]:
    """A connection; its reader takes no more than `limit` bytes that nobody has asked for."""
    client = RawClient(*await asyncio.open_connection("127.0.0.1", port, limit=limit))
    try:
        yield client
    finally:
        await client.close()
