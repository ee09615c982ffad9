"""Standstill of the event loop: nothing else can run meanwhile. Pure."""

SHOWN_S = 10.0
"""A time for which the worst is remembered."""
LIMIT_S = 1.0
"""Longest standstill that is no fault."""
TOLD_AGAIN_S = 60.0


class LoopLag:
    """Delay of looks that should come at a fixed period.

    Args:
        now_s: time of the start, s.
        period_s: of the looks.
    """

    def __init__(self, now_s: float, period_s: float) -> None:
        self._period_s = period_s
        self._looked_s = now_s
        self._worst: list[tuple[float, float]] = []
        self._told_s = float("-inf")

    def begin(self, now_s: float) -> None:
        """Count from now."""
        self._looked_s = now_s

    def look(self, now_s: float) -> float:
        """Take a look in; by how much it came late, s."""
        late_s = max(now_s - self._looked_s - self._period_s, 0.0)
        self._looked_s = now_s
        known = [each for each in self._worst if now_s - each[0] < SHOWN_S and each[1] > late_s]
        self._worst = [*known, (now_s, late_s)]
        return late_s

    @property
    def worst_s(self) -> float:
        """Longest standstill of the last ten seconds, s."""
        return max((late_s for _, late_s in self._worst), default=0.0)

    @property
    def fault(self) -> str:
        """Problem of the loop; empty while it runs as it should."""
        worst_s = self.worst_s
        return f"the event loop was blocked for {worst_s:.1f} s" if worst_s > LIMIT_S else ""

    def is_to_be_told(self, now_s: float) -> bool:
        """Tell whether there is a fault that nobody was told of in the last minute."""
        due = bool(self.fault) and now_s - self._told_s >= TOLD_AGAIN_S
        if due:
            self._told_s = now_s
        return due
