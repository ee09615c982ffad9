"""One Zenoh session: opened on loopback, multicast scouting off."""

import asyncio
import json
import socket
from dataclasses import dataclass
from typing import Any, Literal, Self

import zenoh

from ..messages.addresses import split_endpoint
from ..messages.codec.interface import T
from ..messages.topics import Topic
from .publisher import Publisher
from .subscriber import Subscriber

_EPHEMERAL_TRIES = 5


class BusUnavailableError(Exception):
    """The bus cannot be joined now."""


class BusConfigurationError(Exception):
    """The bus cannot be set up as asked."""


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Settings with which a process takes part in the bus.

    Attributes:
        endpoint: `tcp/<loopback address>:<port>`; port 0 takes any free one.
        role: `router` listens there and passes on between all who connect; `client` connects
            there, to a process with the role `router` or to any other Zenoh router.
    """

    endpoint: str
    role: Literal["router", "client"]


class Bus:
    """A session with its publishers and subscribers; close it to undeclare them all."""

    def __init__(self, session: zenoh.Session, endpoint: str) -> None:
        self._session = session
        self.endpoint = endpoint
        self._subscribers: list[Subscriber[Any]] = []
        self._publishers: list[Publisher[Any]] = []
        self._tokens: list[zenoh.LivelinessToken] = []

    @classmethod
    async def open(cls, settings: BusSettings) -> Self:
        """Open the session.

        Raises:
            BusConfigurationError: the endpoint is not loopback, or in use (`router`).
            BusUnavailableError: nobody answers at the endpoint (`client`).
        """
        try:
            host, port = split_endpoint(settings.endpoint)
        except ValueError as error:
            raise BusConfigurationError(str(error)) from None
        tries = _EPHEMERAL_TRIES if port == 0 and settings.role == "router" else 1
        for attempt in range(tries):
            real_port = port or _free_port(host)
            endpoint = f"tcp/{host}:{real_port}"
            if settings.role == "router":
                _check_free(host, real_port, endpoint)
            try:
                session = await asyncio.to_thread(zenoh.open, _zenoh_config(settings, endpoint))
            except zenoh.ZError as error:
                if attempt + 1 < tries:
                    continue
                if settings.role == "client":
                    raise BusUnavailableError(f"no bus answers at {endpoint}") from error
                raise BusConfigurationError(f"cannot open the bus at {endpoint}") from error
            return cls(session, endpoint)
        raise AssertionError("unreachable")

    def publisher(self, key: str, topic: Topic[T], axis: str | None) -> Publisher[T]:
        """Declare a publisher; it answers queries for its last payload if the topic keeps it."""
        publisher = Publisher(self._session, key, topic, axis)
        self._publishers.append(publisher)
        return publisher

    def subscribe(self, key_expr: str, topic: Topic[T], *, depth: int = 256) -> Subscriber[T]:
        """Subscribe with a ring of `depth` payloads; when it is full the oldest goes, counted."""
        subscriber = Subscriber(self._session, key_expr, topic, depth)
        self._subscribers.append(subscriber)
        return subscriber

    def declare_alive(self, key: str) -> None:
        """Show presence on `key` until the session closes or dies."""
        self._tokens.append(self._session.liveliness().declare_token(key))

    async def close(self) -> None:
        """Undeclare everything and close; safe twice."""
        if self._session.is_closed():
            return
        for subscriber in self._subscribers:
            subscriber.close()
        for publisher in self._publishers:
            publisher.close()
        await asyncio.to_thread(self._session.close)


def _zenoh_config(settings: BusSettings, endpoint: str) -> zenoh.Config:
    router = settings.role == "router"
    config = zenoh.Config()
    for key, value in {
        "mode": settings.role,
        "listen/endpoints": [endpoint] if router else [],
        "connect/endpoints": [] if router else [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/size/data": 16,
        "timestamping/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _free_port(host: str) -> int:
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.bind((host.strip("[]"), 0))
        return int(probe.getsockname()[1])


def _check_free(host: str, port: int, endpoint: str) -> None:
    with socket.socket(_family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host.strip("[]"), port))
        except OSError as error:
            raise BusConfigurationError(f"{endpoint} is in use by another process") from error


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET
