"""One Zenoh session: opened on loopback, or as Zenoh's own file says; multicast scouting off."""

import socket
from collections import Counter
from collections.abc import Collection
from dataclasses import replace
from functools import cache
from typing import Any, Self

import zenoh

from ..clock import now_ns
from ..exit_status import BadInputError
from ..messages.addresses import split_endpoint
from ..messages.codec import T, Topic
from ..threads import Threads
from .publisher import Publisher
from .questions import MOST_OPEN, Answer, Answering
from .settings import BusConfigurationError, BusSettings, zenoh_config
from .subscriber import Subscriber

_EPHEMERAL_TRIES = 5
_OPENERS, _ASKING = Threads("bus", 8), Threads("questions", MOST_OPEN)


class BusUnavailableError(BadInputError):
    """The bus cannot be joined now."""


class Bus:
    """A session with its publishers and subscribers; close it to undeclare them all."""

    def __init__(self, session: zenoh.Session, settings: BusSettings) -> None:
        self._session, self._settings = session, settings
        self.endpoint = settings.endpoint
        self._boot_epoch = now_ns()
        self._subscribers: list[Subscriber[Any]] = []
        self._publishers: dict[str, Publisher[Any]] = {}
        self._near = cache(self._subscribed)
        self._tokens: list[zenoh.LivelinessToken] = []
        self._answering: list[Answering] = []

    @classmethod
    async def open(cls, settings: BusSettings) -> Self:
        """Open the session.

        Raises BusConfigurationError: the endpoint is not loopback, or in use (`router`);
        BusUnavailableError: nobody answers at the endpoint (`client`).
        """
        free = settings.role == "router" and settings.endpoint.endswith(":0")
        tries = _EPHEMERAL_TRIES if free else 1
        for attempt in range(tries):
            placed = _placed(settings)
            try:
                session = await _OPENERS.run(zenoh.open, zenoh_config(placed))
            except zenoh.ZError as error:
                if attempt + 1 < tries:
                    continue
                if settings.role == "client":
                    place = placed.zenoh_file or placed.endpoint
                    raise BusUnavailableError(f"no bus answers at {place}") from error
                raise BusConfigurationError(f"cannot open the bus at {placed.endpoint}") from error
            return cls(session, placed)
        raise AssertionError("unreachable")

    def publisher(self, key: str, topic: Topic[T], axis: str | None) -> Publisher[T]:
        """The publisher of a key; it answers queries for its last payload if the topic keeps it."""
        if key not in self._publishers:
            self._publishers[key] = Publisher(
                self._session, key, topic, axis, self._boot_epoch, self._near, self._settings
            )
        return self._publishers[key]

    def forget(self, prefix: str) -> None:
        """Undeclare the publishers of all keys that begin so."""
        for key in [each for each in self._publishers if each.startswith(prefix)]:
            self._publishers.pop(key).close()

    def subscribe(
        self,
        key_expr: str,
        topic: Topic[T],
        *,
        depth: int = 256,
        keys: Collection[str] | None = None,
    ) -> Subscriber[T]:
        """Subscribe, to `keys` alone if given; a key has a ring of `depth`: the oldest goes."""
        subscriber = Subscriber(self._session, key_expr, topic, depth, keys)
        self._subscribers.append(subscriber)
        self._near.cache_clear()
        return subscriber

    def _subscribed(self, key: str) -> list[Subscriber[Any]]:
        return [each for each in self._subscribers if each.key_expr.includes(key)]

    def refused(self) -> Counter[tuple[str, str]]:
        """Payloads that the subscribers of this process refused, by topic and reason.

        What several of them refused counts once.
        """
        refused: Counter[tuple[str, str]] = Counter()
        for each in self._subscribers:
            counts = each.refusals.counts().items()
            refused |= Counter({(each.topic.name, reason.value): n for reason, n in counts})
        return refused

    def answer(self, key_expr: str, answer: Answer) -> Answering:
        """Answer the questions that are put on `key_expr`, until that is closed."""
        answering = Answering(self._session, key_expr, answer)
        self._answering.append(answering)
        return answering

    async def ask(self, key: str, question: bytes | None, timeout_s: float) -> bytes | None:
        """The first answer to a question; None if nobody is there, or answers in time."""

        def first() -> bytes | None:
            replies = self._session.get(key, payload=question, timeout=timeout_s)
            return next((each.ok.payload.to_bytes() for each in replies if each.ok), None)

        return await _ASKING.run(first)

    def declare_alive(self, key: str) -> None:
        """Show presence on `key` until the session closes or dies."""
        self._tokens.append(self._session.liveliness().declare_token(key))

    async def close(self) -> None:
        if self._session.is_closed():
            return
        declared: list[Any] = [*self._subscribers, *self._publishers.values(), *self._answering]
        for each in declared:
            each.close()
        await _OPENERS.run(self._session.close)


def _placed(settings: BusSettings) -> BusSettings:
    """The settings with a real port, on which nobody listens yet if it is us who will."""
    try:
        host, port = split_endpoint(settings.endpoint)
    except ValueError as error:
        raise BusConfigurationError(str(error)) from None
    if settings.role == "router" or not port:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            if port:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host.strip("[]"), port))
            except OSError as error:
                words = "is in use by another process; choose another (--bus)"
                raise BusConfigurationError(f"tcp/{host}:{port} {words}") from error
            port = int(probe.getsockname()[1])
    return replace(settings, endpoint=f"tcp/{host}:{port}")
