"""Rows of one interval among their neighbours."""

from dataclasses import dataclass

from ..messages.samples import Floats


@dataclass(frozen=True, slots=True, eq=False)
class IntervalRows:
    """Rows of one interval, with those before and after it that its differences need.

    Attributes:
        segment: (n, 8) contiguous rows.
        first, end: row indices; row `end` is the first of the next interval.
        reach: half width in rows of the differences that give direction and acceleration.
    """

    segment: Floats
    first: int
    end: int
    reach: int

    @property
    def inside(self) -> Floats:
        """Rows of the interval and the first of the next, which ends it."""
        return self.segment[self.first : self.end + 1]

    @property
    def ahead(self) -> Floats:
        """Rows after the interval, as many as a difference reaches."""
        return self.segment[self.end + 1 : self.end + 1 + self.reach]

    @property
    def around(self) -> Floats:
        """Rows of the interval with one more on either side."""
        return self.segment[max(self.first - 1, 0) : self.end + 2]
