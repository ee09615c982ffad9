"""Payloads that wait to be read: a ring per key, so that a flood on one key displaces no other."""

from collections import OrderedDict, deque
from dataclasses import dataclass, field
from threading import Lock

MOST_KEYS = 256
MOST_BYTES = 32_000_000
"""Bytes that may wait on one key."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Bytes that came on a key at a time of the steady clock, s."""

    key: str
    payload: bytes
    arrival_s: float


@dataclass(slots=True)
class _Ring:
    """Arrivals of one key, and how many more it may take now.

    Attributes:
        credit: payloads that may still come, as of `credited_s`.
    """

    credit: float
    credited_s: float
    waiting: deque[Arrival] = field(default_factory=deque)
    waiting_bytes: int = 0


class KeyRings:
    """Rings of all keys of one subscriber, read in turn; may be filled from any thread.

    Args:
        depth: payloads that may wait on each key.
        most_hz: payloads per second of each key that are taken at all.
        burst: payloads that may come at once; those of a second unless given.
        most_keys: keys that may have a ring.
    """

    def __init__(
        self, depth: int, most_hz: float, burst: float | None = None, most_keys: int = MOST_KEYS
    ) -> None:
        self._depth = depth
        self._most_hz = most_hz
        self._burst = max(most_hz, 1.0) if burst is None else burst
        self._most_keys = most_keys
        self._lock = Lock()
        self._rings: dict[str, _Ring] = {}
        self._turn: OrderedDict[str, None] = OrderedDict()
        self.overruns = 0
        """Payloads that were pushed out unread."""

    def __bool__(self) -> bool:
        return bool(self._turn)

    def admits(self, key: str, now_s: float) -> bool:
        """Tell whether one more payload may come on a key now, and count it against its rate."""
        with self._lock:
            ring = self._rings.setdefault(key, _Ring(self._burst, now_s))
            earned = (now_s - ring.credited_s) * self._most_hz
            ring.credit, ring.credited_s = min(ring.credit + earned, self._burst), now_s
            if ring.credit < 1.0:
                return False
            ring.credit -= 1.0
            return True

    def knows(self, key: str) -> bool:
        """Tell whether a key has a ring, or may have one."""
        return key in self._rings or len(self._rings) < self._most_keys

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
