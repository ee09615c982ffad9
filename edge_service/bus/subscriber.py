"""Receiving payloads through rings that never block the bus; nothing that is read may be believed.

What is passed on is short enough, well formed, from the one publisher of its key, newer than what
came before, and of the axis that its key names. Everything else is refused, and counted.
"""

import asyncio
import threading
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Collection
from typing import Any, Generic

import zenoh

from ..messages.codec import CodecError, Header, T, Topic
from ..messages.keys import axis_of
from .reception import Arrival, KeyRings, Refusal, Refusals, Sender

_PATIENCE_SHARE = 0.25
"""Of the time after which a topic is stale: after so much silence another publisher is heard."""
_TURN = 32  # payloads after which everybody else gets a turn
_LONGEST_REST_S = 0.2
_EARLY_S = 0.01
"""Time by which something may come before the end of a rest, or else is read after it, s."""
_MOST_RESTING = 16
"""Payloads of a key that wait for the end of a rest, at most."""


class Subscriber(Generic[T]):
    """An asynchronous iterator of `(axis, header, payload)`; ends when it is closed."""

    def __init__(
        self,
        session: zenoh.Session,
        key_expr: str,
        topic: Topic[T],
        depth: int,
        keys: Collection[str] | None = None,
    ) -> None:
        self.refusals = Refusals()
        self.topic, self.key_expr = topic, zenoh.KeyExpr(key_expr)
        self._keys = keys
        self._received = 0
        self._rings = KeyRings(depth, topic.most_hz)
        patience_s = _PATIENCE_SHARE * topic.stale_after_s if topic.rate_hz else 0.0
        self._senders = defaultdict[str, Sender](lambda: Sender(patience_s))
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._wake = asyncio.Event()
        self._closed = False
        self._rests: dict[str, float] = {}
        self._ends: dict[str, asyncio.TimerHandle] = {}
        self._arrival_s = 0.0  # of what was read last
        self._subscriber = session.declare_subscriber(
            key_expr, zenoh.handlers.Callback(self._on_sample, indirect=False)
        )

    def counts(self) -> dict[str, int]:
        """Counts so far, which never fall.

        `ring_overruns` are payloads pushed out of the full ring before they were read;
        `lost_payloads` never arrived, by holes in the sequence (those pushed out included);
        `refused` were not passed on for any reason; `publisher_restarts` are changes of an epoch.
        """
        senders = self._senders.values()
        return {
            "received": self._received,
            "ring_overruns": self._rings.overruns,
            "lost_payloads": sum(sender.lost for sender in senders),
            "malformed": self.refusals.counts()[Refusal.MALFORMED],
            "refused": self.refusals.counts().total(),
            "publisher_restarts": sum(sender.restarts for sender in senders),
        }

    @property
    def has_unread(self) -> bool:
        """Payloads wait, and may still be read."""
        return not self._closed and bool(self._rings)

    def take(self, key: str, told: tuple[str, Header, T]) -> None:
        """Take axis, header and payload of a publisher in the same session, in its thread."""
        if not self._closed:
            self._take(key, 0, lambda: told)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh: takes the bytes, nothing else."""
        self._take(str(sample.key_expr), len(sample.payload), sample.payload.to_bytes)

    def _take(self, key: str, size: int, content: Callable[[], Any]) -> None:
        now_s = time.monotonic()
        self._received += 1
        refusal = self._refusal(key, size, now_s)
        if refusal is not None:
            self.refusals.add(refusal)
            return
        waiting = self._rings.put(Arrival(key, content(), now_s))
        if now_s < self._rests.get(axis_of(key), 0.0) and waiting < _MOST_RESTING:
            return
        if not (self._wake.is_set() or self._loop.is_closed()):
            if threading.get_ident() == self._thread:
                self._wake.set()
            else:
                self._loop.call_soon_threadsafe(self._wake.set)

    def _refusal(self, key: str, size: int, now_s: float) -> Refusal | None:
        known = self._rings.knows(key) if self._keys is None else key in self._keys
        if not known:
            return Refusal.FOREIGN
        if size > self.topic.most_bytes:
            return Refusal.OVERSIZED
        return None if self._rings.admits(key, now_s) else Refusal.FLOODED

    def rest(self, axis: str, seconds: float) -> None:
        """Let what comes of an axis wait for so long after the arrival of what is being read.

        Its reader can make nothing of it before, and to wake costs more than to read.
        """
        if axis in self._ends:
            self._ends.pop(axis).cancel()
        end_s = self._arrival_s + min(seconds, _LONGEST_REST_S)
        self._rests[axis] = end_s - _EARLY_S
        if seconds > 0.0:
            self._ends[axis] = self._loop.call_at(end_s + _EARLY_S, self._wake.set)

    def skip(self, axis: str) -> None:
        """Pass over what waits of an axis; it counts as read."""
        for arrival in self._rings.skip(axis):
            self._heard(arrival)

    async def __aiter__(self) -> AsyncIterator[tuple[str, Header, T]]:
        turns = 0
        while True:
            while (arrival := self._rings.take()) is not None:
                self._arrival_s = arrival.arrival_s
                heard = self._heard(arrival)
                if not isinstance(heard, Refusal):
                    yield heard
                else:
                    self.refusals.add(heard)
                turns += 1
                if turns % _TURN == 0:
                    await asyncio.sleep(0)
            if self._closed:
                return
            self._wake.clear()  # before the last look: the other thread appends, then asks
            if not self._rings:
                await self._wake.wait()

    def _heard(self, arrival: Arrival) -> tuple[str, Header, T] | Refusal:
        """Axis, header and payload; or why they must not be read."""
        told = arrival.payload
        try:
            told = self.topic.decode(told) if isinstance(told, bytes) else told
            self.topic.check(told[2])
        except CodecError:
            return Refusal.MALFORMED
        if told[0] != axis_of(arrival.key):
            return Refusal.MISPLACED
        refusal = self._senders[arrival.key].judge(told[1], arrival.arrival_s)
        return told if refusal is None else refusal

    def close(self) -> None:
        """Undeclare; what is in the ring can still be read, then the iteration ends."""
        if not self._closed:
            self._closed = True
            for each in self._ends.values():
                each.cancel()
            self._subscriber.undeclare()
            self._wake.set()
