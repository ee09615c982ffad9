"""Serving the application by uvicorn: on loopback, or by TLS to those who prove who they are."""

import asyncio
import contextlib
import errno
import ipaddress
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from ..exit_status import BadInputError

MOST_CONNECTIONS = 256
HEAD_BYTES = 16_000
HEAD_S = 10
"""Time in which the head of a request must come, and the next one after an answer."""
STALLED_S = 30
"""Time after which the system drops a connection whose client no longer reads."""
_SEND_BUFFER_BYTES = 64_000
_GRACE_S = 2
_TCP_USER_TIMEOUT = getattr(socket, "TCP_USER_TIMEOUT", None)  # Linux


class AddressError(BadInputError, ValueError):
    """An address that the service must not, or cannot, listen on."""


class PortInUseError(AddressError):
    """Another program listens on the address."""


class _Protocol(H11Protocol):
    """Uvicorn's connection, with its deadline of the next request also for the first one."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a head; connections beyond their number are dropped."""
        super().connection_made(transport)
        if len(self.connections) > MOST_CONNECTIONS:
            transport.abort()
            return
        self.timeout_keep_alive_task = self.loop.call_later(
            self.timeout_keep_alive, self.timeout_keep_alive_handler
        )

    def data_received(self, data: bytes) -> None:
        """Take in a part of a request; only a whole head ends the deadline."""
        self.conn.receive_data(data)
        self.handle_events()


class _Server(uvicorn.Server):
    """Uvicorn without its own handlers of signals: the process that wires the nodes has them."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def serve(
    app: ASGIApp,
    host: str,
    port: int,
    *,
    tls: tuple[Path, Path] | None = None,
    on_bound: Callable[[str, int], None] = lambda _host, _port: None,
    before_stop: Callable[[], None] = lambda: None,
) -> None:
    """Serve until the task is cancelled, and end in good order.

    Args:
        tls: Certificate and private key in PEM; without them only loopback is served.
        before_stop: Called before the server waits for its connections to end: end the live streams
            here (`ServiceState.close`), or they are cut off after a short grace.

    Raises AddressError: Before anything is served: the address makes no sense, needs TLS
    (PortInUseError: or is taken).
    """
    listener = bind(host, port, encrypted=tls is not None)
    certificate, key = tls or (None, None)
    config = uvicorn.Config(
        app,
        http=_Protocol,
        backlog=32,
        limit_concurrency=MOST_CONNECTIONS,
        timeout_keep_alive=HEAD_S,
        h11_max_incomplete_event_size=HEAD_BYTES,
        timeout_graceful_shutdown=_GRACE_S,
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws="none",
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    server = _Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    try:
        address = listener.getsockname()
        on_bound(str(address[0]), int(address[1]))
        await asyncio.shield(serving)
    finally:
        before_stop()
        server.should_exit = True
        try:
            await serving
        finally:
            listener.close()


def bind(host: str, port: int, *, encrypted: bool = False) -> socket.socket:
    """A socket that listens, on loopback unless `encrypted`; AddressError if that cannot be."""
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise AddressError(f"host {host!r} is not an IP address: expected e.g. 127.0.0.1") from None
    if not (encrypted or address.is_loopback):
        raise AddressError(f"host {host}: only loopback addresses are served without TLS")
    if not 0 <= port <= 65535:
        raise AddressError(f"port {port} is not a TCP port: expected 0 to 65535")
    family = socket.AF_INET6 if address.version == 6 else socket.AF_INET
    # named TCP, or asyncio leaves Nagle on and every kept-alive answer waits 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        if _TCP_USER_TIMEOUT is not None:
            listener.setsockopt(socket.IPPROTO_TCP, _TCP_USER_TIMEOUT, round(STALLED_S * 1000))
        listener.bind((str(address), port))
        listener.listen()
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise PortInUseError(
                f"{host}:{port} is in use by another program: choose another (--port)"
            ) from error
        raise AddressError(f"cannot listen on {host}:{port}: {error.strerror}") from error
    return listener
