"""Payloads on their way to a reader: rings, the one publisher of a key, and what is refused."""

from collections import Counter, OrderedDict, deque
from dataclasses import dataclass, field
from enum import StrEnum
from threading import Lock
from typing import Any, NamedTuple

from ..messages.codec import Header
from ..messages.keys import axis_of

MOST_RINGS = 256
MOST_BYTES = 32_000_000
"""Bytes that may wait on one key."""
MOST_JUMP = 100_000
"""So many payloads may be lost at once; a longer jump of the sequence is another's."""


class Refusal(StrEnum):
    """Reason for which a payload is not passed on."""

    FOREIGN = "foreign"  # the key of an axis or component that is not configured
    OVERSIZED = "oversized"  # longer than its topic allows
    FLOODED = "flooded"  # more of them than its topic allows
    MALFORMED = "malformed"  # no payload of its topic
    MISPLACED = "misplaced"  # the payload names another axis than its key
    RIVAL = "rival"  # another publisher of the key is heard
    SURPLUS = "surplus"  # it names one sensor more than an axis may have
    LATE = "late"  # overtaken by a newer one, or sent twice


class Refusals:
    """Counts of one subscriber by reason, from any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._counts: Counter[Refusal] = Counter()

    def add(self, reason: Refusal) -> None:
        with self._lock:
            self._counts[reason] += 1

    def counts(self) -> Counter[Refusal]:
        with self._lock:
            return Counter(self._counts)


class Sender:
    """The publisher that is heard on one key.

    Another one is heard once this one has been silent for a moment: it was restarted. Until then
    it is a rival, whatever its boot epoch says; and whatever sequence number a stranger uses, it
    is believed for no longer.
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._last: Header | None = None
        self._heard_s = 0.0
        self.lost = 0  # payloads that never arrived, by holes in the sequence
        self.restarts = 0  # changes of the publisher

    def judge(self, header: Header, arrival_s: float) -> Refusal | None:
        """Take a payload in; why it must not be read, if so."""
        if self._last is not None:
            step = header.sequence - self._last.sequence
            refusal = None
            if header.boot_epoch != self._last.boot_epoch or step > MOST_JUMP:
                refusal = Refusal.RIVAL
            elif step <= 0:
                refusal = Refusal.LATE
            if refusal is None:
                self.lost += step - 1
            elif arrival_s - self._heard_s < self._patience_s:
                return refusal
            else:
                self.restarts += 1
        self._last, self._heard_s = header, arrival_s
        return None


class Arrival(NamedTuple):
    """Bytes, or what they would hold, that came on a key at a time of the steady clock, s."""

    key: str
    payload: bytes | tuple[str, Header, Any]
    arrival_s: float


@dataclass(slots=True)
class _Ring:
    """Arrivals of one key, and how many more it may take as of `credited_s`."""

    credit: float
    credited_s: float
    waiting: deque[Arrival] = field(default_factory=deque)
    waiting_bytes: int = 0


class KeyRings:
    """Rings of `depth` payloads a key, of at most `most_hz`; read in turn, filled by any thread."""

    def __init__(self, depth: int, most_hz: float) -> None:
        self._depth, self._most_hz = depth, most_hz
        self._lock = Lock()
        self._rings: dict[str, _Ring] = {}
        self._turn: OrderedDict[str, None] = OrderedDict()
        self.overruns = 0  # payloads that were pushed out unread

    def __bool__(self) -> bool:
        return bool(self._turn)

    def admits(self, key: str, now_s: float) -> bool:
        """Count a payload against the rate of its key; False where it came too soon."""
        with self._lock:
            ring = self._rings.get(key) or self._rings.setdefault(key, _Ring(self._most_hz, now_s))
            earned = (now_s - ring.credited_s) * self._most_hz
            ring.credit, ring.credited_s = min(ring.credit + earned, self._most_hz), now_s
            admitted = ring.credit >= 1.0
            ring.credit -= admitted
            return admitted

    def knows(self, key: str) -> bool:
        """Return whether a key has a ring, or may have one."""
        return key in self._rings or len(self._rings) < MOST_RINGS

    def put(self, arrival: Arrival) -> int:
        """Let a payload wait; the oldest of its key make room. Returns how many wait there."""
        with self._lock:
            ring = self._rings[arrival.key]
            ring.waiting.append(arrival)
            ring.waiting_bytes += len(arrival.payload)
            while len(ring.waiting) > self._depth or ring.waiting_bytes > MOST_BYTES:
                ring.waiting_bytes -= len(ring.waiting.popleft().payload)
                self.overruns += 1
            self._turn.setdefault(arrival.key)
            return len(ring.waiting)

    def skip(self, axis: str) -> list[Arrival]:
        """All payloads of an axis, which wait no longer."""
        skipped: list[Arrival] = []
        with self._lock:
            for key, ring in self._rings.items():
                if axis_of(key) == axis:
                    self._turn.pop(key, None)
                    skipped += ring.waiting
                    ring.waiting.clear()
                    ring.waiting_bytes = 0
        return skipped

    def take(self) -> Arrival | None:
        """The oldest payload of the key whose turn it is; None if none waits."""
        with self._lock:
            if not self._turn:
                return None
            key, _ = self._turn.popitem(last=False)
            ring = self._rings[key]
            arrival = ring.waiting.popleft()
            ring.waiting_bytes -= len(arrival.payload)
            if ring.waiting:
                self._turn[key] = None
            return arrival
