"""Payloads that were refused, counted by key and reason in bounded memory."""

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from functools import reduce
from operator import or_
from threading import Lock

OTHERS = "(others)"
MOST_KEYS, MOST_LETTERS = 32, 120


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
    """Counts of one subscriber, from any thread."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._keys: set[str] = set()
        self._counts: Counter[tuple[str, str]] = Counter()

    def add(self, key: str, reason: Refusal) -> None:
        """Count one; the keys beyond a number share one count."""
        with self._lock:
            name = key if len(key) <= MOST_LETTERS else key[:MOST_LETTERS] + "..."
            if name not in self._keys and len(self._keys) >= MOST_KEYS:
                name = OTHERS
            self._keys.add(name)
            self._counts[name, reason] += 1

    def counts(self) -> Counter[tuple[str, str]]:
        """The counts so far."""
        with self._lock:
            return Counter(self._counts)

    def total(self, reason: Refusal) -> int:
        """Number of payloads refused for one reason."""
        return sum(count for (_, each), count in self.counts().items() if each is reason)


def together(refusals: Iterable[Refusals]) -> Counter[tuple[str, str]]:
    """Counts of several subscribers; what several of them refused counts once."""
    return reduce(or_, (each.counts() for each in refusals), Counter())
