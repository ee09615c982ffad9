"""Adapter for agents: bounded clients, which can ask for nothing but a sign of life."""

import asyncio
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ... import __version__
from ...messages.answer import AxisAnswer
from .shdr import Values, changes, lines, values_of

HEARTBEAT_S = 10.0
"""An agent that has asked once asks again within this time; after twice as long it is cut off."""
UNREAD_BYTES = 1_000_000
"""Bytes that may wait for a client that does not read; then it is cut off."""
LINE_BYTES = 1024
HEARTBEAT_BYTES = 16_384
"""Bytes that a client may send within a heartbeat."""
_GREETING = (f"* adapterVersion: {__version__}", "* shdrVersion: 2.0", "* mtconnectVersion: 2.0")


_HERE: Values = {("avail", ""): ("AVAILABLE",)}


@dataclass(frozen=True, slots=True)
class _Shown:
    """Values of an axis as they were told last, and when its newest sample was measured."""

    values: Values
    measured_ns: int | None


class Adapter:
    """Shows answers to all agents that are connected.

    Args:
        clients: how many there may be at once.
        clock: monotonic, s.
    """

    def __init__(self, clients: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._most, self._clock = clients, clock
        self._clients: set[_Client] = set()
        self._server: asyncio.Server | None = None
        self._shown: dict[str, _Shown] = {}
        self._now_ns = 0
        self.cut_off = 0

    @property
    def clients(self) -> int:
        """Number of clients that are connected."""
        return len(self._clients)

    @property
    def port(self) -> int:
        """The port at which it listens; 0 before."""
        return 0 if self._server is None else int(self._server.sockets[0].getsockname()[1])

    async def start(self, host: str, port: int) -> None:
        """Listen. Raises OSError. Being cancelled leaves nothing that `stop` does not end."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._meet, host, port, start_serving=False)
        await self._server.start_serving()

    def stop(self) -> None:
        """End all connections; safe without a start."""
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.cut_off()

    def show(self, answers: Iterable[AxisAnswer], now_ns: int) -> None:
        """Tell all clients what has changed, and cut off those that are silent."""
        told: list[str] = []
        for answer in answers:
            before, known = self._shown.get(answer.axis), values_of(answer)
            news = changes(before.values if before else {}, known)
            told += lines(news, now_ns, answer.measured_ns)
            self._shown[answer.axis] = _Shown(known, answer.measured_ns)
        self._now_ns = now_ns
        for client in tuple(self._clients):
            client.look(self._clock())
            client.tell(told)

    def _meet(self) -> "_Client":
        return _Client(self)

    def admit(self, client: "_Client") -> Sequence[str]:
        """Take a client in; what it is to be told first, nothing if there are too many."""
        if len(self._clients) >= self._most:
            return ()
        self._clients.add(client)
        whole = [*_GREETING, *lines(_HERE, self._now_ns)]
        for shown in self._shown.values():
            whole += lines(shown.values, self._now_ns, shown.measured_ns)
        return whole

    def leave(self, client: "_Client") -> None:
        """Forget a client."""
        self._clients.discard(client)

    def now_s(self) -> float:
        """Time on the clock, s."""
        return self._clock()


class _Client(asyncio.Protocol):
    """Connection of one agent."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._transport: asyncio.Transport | None = None
        self._begun = b""
        self._asked_s: float | None = None
        self._came, self._since_s = 0, adapter.now_s()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet, or refuse what is too much."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        first = self._adapter.admit(self)
        if not first:
            transport.abort()
            return
        transport.set_write_buffer_limits(high=UNREAD_BYTES)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.tell(first)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._adapter.leave(self)

    def pause_writing(self) -> None:
        """Cut off whoever does not read."""
        self.cut_off()

    def data_received(self, data: bytes) -> None:
        """Answer signs of life; all else is ignored, and too much of it ends the connection."""
        self._came += len(data)
        *whole, self._begun = (self._begun + data).split(b"\n")
        if self._came > HEARTBEAT_BYTES or len(self._begun) > LINE_BYTES:
            self.cut_off()
            return
        if any(line.strip() == b"* PING" for line in whole):
            self._asked_s = self._adapter.now_s()
            self.tell([f"* PONG {HEARTBEAT_S * 1000.0:.0f}"])

    def tell(self, told: Sequence[str]) -> None:
        """Send lines."""
        if self._transport is not None and told and not self._transport.is_closing():
            self._transport.write(("\n".join(told) + "\n").encode())

    def look(self, now_s: float) -> None:
        """Cut off whoever has asked for a sign of life and asks no more."""
        if now_s - self._since_s > HEARTBEAT_S:
            self._came, self._since_s = 0, now_s
        if self._asked_s is not None and now_s - self._asked_s > 2.0 * HEARTBEAT_S:
            self.cut_off()

    def cut_off(self) -> None:
        """End the connection at once."""
        if self._transport is not None and not self._transport.is_closing():
            self._adapter.cut_off += 1
            self._transport.abort()
