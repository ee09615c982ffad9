"""Serving the application: on loopback, or by TLS to those who prove who they are."""

import asyncio
import contextlib
import errno
import ipaddress
import logging
import socket
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from .limits.connections import Connections
from .limits.descriptors import affordable_connections, open_descriptors, raise_limit
from .limits.handshakes import HandshakeListener
from .limits.protocol import bounded_protocol
from .limits.settings import HttpLimits

log = logging.getLogger(__name__)
_GRACE_S = 2


class AddressError(ValueError):
    """An address that the service must not, or cannot, listen on."""


class PortInUseError(AddressError):
    """Another program listens on the address."""


class _Server(uvicorn.Server):
    """Uvicorn without its own handlers of signals: the process that wires the nodes has them."""

    beat: Callable[[], None] = staticmethod(lambda: None)
    handshake_s = 10.0

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn does for sockets, but a TLS handshake has a deadline."""
        config = self.config
        protocol: Callable[..., asyncio.Protocol] = config.http_protocol_class
        make = partial(protocol, config=config, server_state=self.server_state, app_state={})
        within_s = self.handshake_s if config.is_ssl else None
        loop = asyncio.get_running_loop()
        self.servers = [
            await loop.create_server(
                make,
                sock=each,
                ssl=config.ssl,
                backlog=config.backlog,
                ssl_handshake_timeout=within_s,
                ssl_shutdown_timeout=within_s,
            )
            for each in sockets or ()
        ]
        self.started = True

    async def on_tick(self, counter: int) -> bool:
        """Show a sign of life; called ten times a second."""
        self.beat()
        return await super().on_tick(counter)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


async def serve(
    app: ASGIApp,
    host: str,
    port: int,
    *,
    stop: asyncio.Event,
    tls: tuple[Path, Path] | None = None,
    on_bound: Callable[[str, int], None] = lambda _host, _port: None,
    before_stop: Callable[[], None] = lambda: None,
    limits: HttpLimits | None = None,
    on_tick: Callable[[], None] = lambda: None,
) -> None:
    """Serve until `stop` is set or the task is cancelled; both end it in good order.

    Args:
        app: The application.
        host: An IP address or `localhost`.
        port: TCP port; 0 takes a free one.
        stop: Set to end.
        tls: Certificate and private key in PEM; without them only loopback is served.
        on_bound: Called with the address and the real port as soon as connections are taken.
        before_stop: Called before the server waits for its connections to end: end the live streams
            here (`ServiceState.close`), or they are cut off after a short grace.
        limits: Bounds of connections, heads and times.
        on_tick: Called ten times a second while the server lives.

    Raises:
        AddressError: Before anything is served: the address makes no sense, needs TLS
            (PortInUseError: or is taken).
    """
    limits = limits or HttpLimits()
    places = places_for(limits, encrypted=tls is not None)
    listener = bind(host, port, encrypted=tls is not None)
    if tls is not None:
        listener = HandshakeListener(listener, limits, places)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, limits.send_buffer_bytes)
    certificate, key = tls or (None, None)
    config = uvicorn.Config(
        app,
        http=bounded_protocol(limits, places),
        backlog=min(limits.backlog, max(places.most // 2, 1)),
        h11_max_incomplete_event_size=limits.head_bytes,
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws="none",
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )
    server = _Server(config)
    server.beat, server.handshake_s = on_tick, limits.head_s
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    stopping = asyncio.create_task(stop.wait())
    try:
        address = listener.getsockname()
        on_bound(str(address[0]), int(address[1]))
        await asyncio.wait({serving, stopping}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopping.cancel()
        before_stop()
        server.should_exit = True
        try:
            await serving
        finally:
            listener.close()


def places_for(limits: HttpLimits, *, encrypted: bool = False) -> Connections:
    """As many places for connections as are wanted, and as there are descriptors for."""
    limit, opened = raise_limit(), open_descriptors()
    reserve = limits.reserve + (limits.handshakes if encrypted else 0)
    most = affordable_connections(limit, limits.connections, reserve, opened)
    if most < limits.connections:
        log.warning(
            "%d connections at once, not %d: the limit of open files is %d",
            most,
            limits.connections,
            limit,
        )
    return Connections(most, limits.connections_of_one)


def bind(host: str, port: int, *, encrypted: bool = False) -> socket.socket:
    """A socket that listens, on loopback unless `encrypted`; AddressError if that cannot be."""
    address = _address(host)
    if not (encrypted or address.is_loopback):
        raise AddressError(f"host {host}: only loopback addresses are served without TLS")
    if not 0 <= port <= 65535:
        raise AddressError(f"port {port} is not a TCP port: expected 0 to 65535")
    family = socket.AF_INET6 if address.version == 6 else socket.AF_INET
    # named TCP, or asyncio leaves Nagle on and every kept-alive answer waits 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((str(address), port))
        listener.listen()
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise _bind_error(host, port, error) from error
    return listener


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    try:
        return ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.strip("[]"))
    except ValueError:
        raise AddressError(f"host {host!r} is not an IP address: expected e.g. 127.0.0.1") from None


def _bind_error(host: str, port: int, error: OSError) -> AddressError:
    if error.errno == errno.EADDRINUSE:
        return PortInUseError(
            f"{host}:{port} is in use by another program: choose another (--port)"
        )
    return AddressError(f"cannot listen on {host}:{port}: {error.strerror}")
