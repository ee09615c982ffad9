"""Time from `CYCLE`, the count of the position controller's cycles."""

import itertools

import numpy as np

from ...messages.samples import Floats

PERIOD_S = 0.002
"""Of Industrial Edge's high-frequency data: 500 Hz."""
RESTART_GAP_S = 1.0
"""Time between two runs where the count begins anew."""
WIDE = 1.5
"""A step of so many usual ones is a gap."""


class CycleClock:
    """Time of each sample, from 0 at the first one; gaps and restarts are counted.

    A count that falls is the recorder begun anew: a new run, a second after the one before. A count
    that stays is the same sample again, and is handed on as it is.

    Attributes:
        period_s: of the count.
        restarts, gaps: how often the count has begun anew, and has left out samples.
        lost: samples that it has left out.
    """

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.restarts = 0
        self._restart_rows: list[int] = []
        self._rows = 0
        self.gaps = 0
        self.lost = 0.0
        self._usual: float | None = None
        self._last: float | None = None
        self._origin = 0.0
        self._offset = 0.0  # of the run, in counts: the same sums however a recording is parted

    @property
    def step_s(self) -> float | None:
        """Usual time from one sample to the next; None before two have come."""
        return None if self._usual is None else self._usual * self.period_s

    def times(self, cycle: Floats) -> tuple[Floats, Floats]:
        """Times in s and number of the run of each sample, (n,); NaN where there is no count."""
        counted = np.isfinite(cycle)
        time_s, run = np.full(cycle.shape, np.nan), np.full(cycle.shape, float(self.restarts))
        counts = cycle[counted]
        if len(counts):
            if self._last is None:
                self._origin = self._last = float(counts[0])
            time_s[counted], run[counted] = self._counted(counts, np.flatnonzero(counted))
        self._rows += len(cycle)
        return time_s, run

    def _counted(self, counts: Floats, rows: np.ndarray) -> tuple[Floats, Floats]:
        assert self._last is not None
        before = np.concatenate(([self._last], counts[:-1]))
        steps = counts - before
        self._count_gaps(steps)
        time_s, run = np.empty(len(counts)), np.empty(len(counts))
        ends = sorted({0, *np.flatnonzero(steps < 0.0).tolist(), len(counts)})
        for start, stop in itertools.pairwise(ends):
            if steps[start] < 0.0:
                self._restart(float(before[start]), float(counts[start]), int(rows[start]))
            part = slice(start, stop)
            time_s[part] = (self._offset + (counts[part] - self._origin)) * self.period_s
            run[part] = self.restarts
        self._last = float(counts[-1])
        return time_s, run

    def _restart(self, before: float, first: float, row: int) -> None:
        self._offset += (before - self._origin) + RESTART_GAP_S / self.period_s
        self._origin = first
        self.restarts += 1
        self._restart_rows.append(self._rows + row)

    def _count_gaps(self, steps: Floats) -> None:
        forward = steps[steps > 0.0]
        if self._usual is None and len(forward):
            self._usual = float(np.median(forward))
        if self._usual is not None:
            wide = steps[steps > WIDE * self._usual]
            self.gaps += len(wide)
            self.lost += float(np.sum(wide / self._usual - 1.0))

    def remarks(self) -> list[str]:
        """One line each on the period, on gaps and on restarts."""
        step = self._usual or 1.0
        every = "" if step == 1.0 else f", every {step:g}. one recorded"
        lines = [f"time_s = {self.period_s:g} s * CYCLE{every}"]
        if self.gaps:
            lines.append(f"CYCLE: {self.gaps} gaps, {self.lost:.0f} samples missing")
        if self.restarts:
            shown = ", ".join(str(row) for row in self._restart_rows[:5])
            more = ", ..." if self.restarts > 5 else ""
            lines.append(
                f"CYCLE starts over {self.restarts} times (at row {shown}{more}): each is a new "
                f"run, {RESTART_GAP_S:g} s after the one before"
            )
        return lines
