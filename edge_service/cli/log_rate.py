"""Rate of the log: no place in the program can fill a disk."""

import logging
import time
from collections.abc import Callable

BURST = 20
PER_S = 0.2


class LogRate(logging.Filter):
    """Lets each place that logs say `burst` lines at once, then one every `1 / per_s` seconds.

    What was left out is counted, and told with the next line of that place.
    """

    def __init__(
        self,
        burst: int = BURST,
        per_s: float = PER_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._burst, self._per_s, self._clock = burst, per_s, clock
        self._places: dict[tuple[str, int], _Place] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Tell whether a record is to be written."""
        now_s = self._clock()
        where = (record.pathname, record.lineno)
        place = self._places.setdefault(where, _Place(self._burst, now_s))
        place.lines = min(self._burst, place.lines + (now_s - place.seen_s) * self._per_s)
        place.seen_s = now_s
        if place.lines < 1.0:
            place.left_out += 1
            return False
        place.lines -= 1.0
        if place.left_out:
            record.msg = f"{record.getMessage()} (and {place.left_out} times more)"
            record.args = None
            place.left_out = 0
        return True


class _Place:
    """One place in the program that logs: lines it may write now, and those it could not."""

    def __init__(self, lines: float, now_s: float) -> None:
        self.lines, self.seen_s, self.left_out = lines, now_s, 0
