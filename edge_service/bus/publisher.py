"""Publishing payloads of one key, and answering for the last of them."""

from collections.abc import Callable
from itertools import count
from time import monotonic_ns
from typing import Any, Generic

import zenoh
from zenoh import ext

from ..messages.codec import JSON_ENCODING, Header, T, Topic
from .settings import BusSettings
from .subscriber import Subscriber

_HEARTBEAT_S = 10.0
"""Period in which the number of the last payload is told, by which a reader learns what it missed.

Told once, it would be lost with the router that was to pass it on.
"""


class Publisher(Generic[T]):
    """Numbers, stamps and puts payloads; never waits for a reader.

    Those in the same session, which `near` finds, get a payload as it is; others its encoding.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        topic: Topic[T],
        axis: str | None,
        boot_epoch: int,
        near: Callable[[str], list[Subscriber[T]]],
        settings: BusSettings,
    ) -> None:
        urgent = topic.encoding == JSON_ENCODING  # samples may wait to share a batch: fewer drops
        cached = topic.cached if settings.zenoh_file else 0  # for readers at routers of the plant
        self._encoding = zenoh.Encoding(topic.encoding)
        self._key, self._topic, self._axis, self._near = key, topic, axis, near
        sending: dict[str, Any] = {
            "encoding": self._encoding,
            "congestion_control": zenoh.CongestionControl.DROP,
            "priority": zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
            "express": urgent,
            "allowed_destination": zenoh.Locality.REMOTE,
        }
        self._publisher: Any = (
            ext.declare_advanced_publisher(
                session,
                key,
                **sending,
                cache=ext.CacheConfig(max_samples=cached),
                sample_miss_detection=ext.MissDetectionConfig(
                    heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None
                ),
                publisher_detection=True,
            )
            if cached
            else session.declare_publisher(key, **sending)
        )
        self._asks = settings.role == "router" and not cached  # a client learns late
        self._last: tuple[Header, T] | None = None
        self._queryable = (
            session.declare_queryable(
                key, zenoh.handlers.Callback(self._answer, indirect=False), complete=True
            )
            if topic.keeps_last
            else None
        )
        self.boot_epoch, self._count = boot_epoch, count()

    def publish(self, payload: T, source_time_ns: int) -> Header:
        """Put with the next header; returns the header that went out."""
        header = Header(next(self._count), self.boot_epoch, max(source_time_ns, 0), monotonic_ns())
        self._last = header, payload
        for each in self._near(self._key):
            each.take(self._key, (self._axis or "", header, payload))
        if not self._asks or self._publisher.matching_status.matching:
            self._publisher.put(self._topic.encode(self._axis, header, payload))
        return header

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            if self._last is not None:
                last = self._topic.encode(self._axis, *self._last)
                query.reply(self._key, last, encoding=self._encoding)

    def close(self) -> None:
        """Undeclare; called once by the bus."""
        if self._queryable is not None:
            self._queryable.undeclare()
        self._publisher.undeclare()
