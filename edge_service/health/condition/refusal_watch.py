"""Events about payloads that were refused on the bus: few, however many there are."""

from collections import Counter

from ...messages.event import Event, Severity
from .input_watch import NS_PER_S

Refused = Counter[tuple[str, str]]
"""Counts by key and reason."""
_QUIET_S = 600
_MOST_TOLD = 4


class RefusalWatch:
    """Tells of refusals, key by key: at once when they begin, then every ten minutes at most.

    Overtaken payloads are no sign of anything: they are counted, not told.
    """

    def __init__(self) -> None:
        self._seen: Counter[str] = Counter()
        self._told_ns: dict[str, int] = {}

    def tick(self, refused: Refused, now_ns: int) -> tuple[Event, ...]:
        """Events of what was refused since they were last told."""
        news = [key for key, count in _by_key(refused).items() if count > self._seen[key]]
        due = [key for key in news if self._is_due(key, now_ns)][:_MOST_TOLD]
        return tuple(self._tell(key, refused, now_ns) for key in due)

    def _is_due(self, key: str, now_ns: int) -> bool:
        told_ns = self._told_ns.get(key)
        return told_ns is None or abs(now_ns - told_ns) >= _QUIET_S * NS_PER_S

    def _tell(self, key: str, refused: Refused, now_ns: int) -> Event:
        reasons = {reason: count for (each, reason), count in refused.items() if each == key}
        total = sum(count for reason, count in reasons.items() if reason != "late")
        new = total - self._seen[key]
        self._seen[key], self._told_ns[key] = total, now_ns
        words = ", ".join(reason.replace("_", " ") for reason in sorted(reasons))
        return Event(
            axis="",
            kind="component_changed",
            severity=Severity.WARNING,
            message=f"{new} payloads on {key} were refused ({words}): who sends them?",
            time_ns=now_ns,
            data={"key": key, "refused": new},
        )


def _by_key(refused: Refused) -> Counter[str]:
    counts: Counter[str] = Counter()
    for (key, reason), count in refused.items():
        if reason != "late":
            counts[key] += count
    return counts
