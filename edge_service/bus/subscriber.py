"""Receiving payloads through a ring that never blocks the bus."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import asdict, dataclass
from typing import Generic

import zenoh

from ..messages.codec.interface import CodecError, T
from ..messages.header import Header
from ..messages.topics import Topic


@dataclass(slots=True)
class ReceiveCounters:
    """Monotonic counts of one subscriber.

    Attributes:
        received: payloads taken from the bus.
        ring_overruns: payloads pushed out of the full ring before they were read.
        lost_payloads: payloads that never arrived, by holes in the sequence numbers
            (those pushed out of the ring included).
        malformed: payloads that could not be decoded.
        publisher_restarts: changes of a boot epoch.
    """

    received: int = 0
    ring_overruns: int = 0
    lost_payloads: int = 0
    malformed: int = 0
    publisher_restarts: int = 0

    def as_dict(self) -> dict[str, int]:
        """The counts by name."""
        return asdict(self)


class Subscriber(Generic[T]):
    """An asynchronous iterator of `(axis, header, payload)`; ends when it is closed."""

    def __init__(self, session: zenoh.Session, key_expr: str, topic: Topic[T], depth: int) -> None:
        self.counters = ReceiveCounters()
        self._decode = topic.decode
        self._ring: deque[tuple[str, bytes]] = deque(maxlen=depth)
        self._expected: dict[str, tuple[int, int]] = {}
        self._loop = asyncio.get_running_loop()
        self._wake = asyncio.Event()
        self._waiting = False
        self._closed = False
        self._subscriber = session.declare_subscriber(
            key_expr, zenoh.handlers.Callback(self._on_sample, indirect=False)
        )

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh: takes the bytes, nothing else."""
        ring = self._ring
        if len(ring) == ring.maxlen:
            self.counters.ring_overruns += 1
        self.counters.received += 1
        ring.append((str(sample.key_expr), sample.payload.to_bytes()))
        if self._waiting and not self._loop.is_closed():
            self._waiting = False
            self._loop.call_soon_threadsafe(self._wake.set)

    async def __aiter__(self) -> AsyncIterator[tuple[str, Header, T]]:
        while True:
            while self._ring:
                key, payload = self._ring.popleft()
                try:
                    axis, header, value = self._decode(payload)
                except CodecError:
                    self.counters.malformed += 1
                    continue
                self._follow(key, header)
                yield axis, header, value
            if self._closed:
                return
            self._wake.clear()
            self._waiting = True  # before the last look: the other thread appends, then asks
            if not self._ring:
                await self._wake.wait()
            self._waiting = False

    def _follow(self, key: str, header: Header) -> None:
        """Count the holes in a key's sequence numbers."""
        boot_epoch, expected = self._expected.get(key, (header.boot_epoch, header.sequence))
        if boot_epoch != header.boot_epoch:
            self.counters.publisher_restarts += 1
        elif header.sequence > expected:
            self.counters.lost_payloads += header.sequence - expected
        self._expected[key] = (header.boot_epoch, header.sequence + 1)

    def close(self) -> None:
        """Undeclare; what is in the ring can still be read, then the iteration ends."""
        if not self._closed:
            self._closed = True
            self._subscriber.undeclare()
            self._wake.set()
