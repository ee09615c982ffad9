"""Restart policy: pauses before a failed task is begun again, and its end. Pure."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """Pauses before a task is begun again, and their number.

    Attributes:
        first_s: pause after the first failure; every further one in a row doubles it.
        cap_s: longest pause.
        most: failures in a row that are borne.
        steady_s: a task that has run for so long has left its failures behind.
    """

    first_s: float = 0.2
    cap_s: float = 30.0
    most: int = 10
    steady_s: float = 60.0


_MOST_DOUBLINGS = 60


class Restarts:
    """Count of the failures of one task."""

    def __init__(self, policy: RestartPolicy) -> None:
        self._policy = policy
        self._in_a_row = 0
        self.total = 0

    def pause_s(self, ran_s: float) -> float | None:
        """Note a failure after `ran_s`; the pause before the next try, s, or None to give up."""
        policy = self._policy
        self._in_a_row = 1 if ran_s >= policy.steady_s else self._in_a_row + 1
        if self._in_a_row > policy.most:
            return None
        self.total += 1
        return float(
            min(policy.cap_s, policy.first_s * 2.0 ** min(self._in_a_row - 1, _MOST_DOUBLINGS))
        )
