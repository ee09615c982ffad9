"""Preload since the part came into use, in few points however long that is."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.arrays import StoredFloats
from ...messages.samples import Floats

MOST_POINTS = 400
_COLUMNS = 5
_LONGEST_STEP_S = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class PreloadSteps:
    """Steps of a preload history.

    Attributes:
        step_s: length of a step, s.
        rows: step number, count, preload (percent), half width (percent), distance (m), (n, 5).
    """

    step_s: float
    rows: StoredFloats


class PreloadHistory:
    """Means of preload over equal steps of time; the steps double whenever there are too many.

    Args:
        step_s: The first length of a step, s.
    """

    def __init__(self, step_s: float = 1.0) -> None:
        self._first_step_s = self._step_s = step_s
        self._rows: list[list[float]] = []  # step number, count, value, half width, distance

    def add(self, time_s: float, percent: float, half_width: float, distance_m: float) -> None:
        """Take an estimate in.

        Args:
            time_s: UNIX time, s; what lies behind it ends there, should it end later.
            percent, half_width: Preload and half the width of its 95 % interval, percent.
            distance_m: Way of the table since the part came into use, m.
        """
        step = float(time_s // self._step_s)
        if self._rows and step <= self._rows[-1][0] - 1.0:
            self.move((step - self._rows[-1][0]) * self._step_s)  # nobody told of the step
        if not self._rows or step > self._rows[-1][0]:
            self._rows.append([step, 0.0, 0.0, 0.0, 0.0])
        row = self._rows[-1]
        row[1] += 1.0
        for column, value in ((2, percent), (3, half_width), (4, distance_m)):
            row[column] += (value - row[column]) / row[1]
        if len(self._rows) > MOST_POINTS:
            self._coarsen()

    def move(self, step_s: float, since_s: float = -math.inf) -> None:
        """The clock was set by a step, s: the distances in time stay.

        Args:
            since_s: what is older stays where it is; what comes to lie on it is joined to it.
        """
        rows, self._rows = self._rows, []
        for row in rows:
            if (row[0] + 1.0) * self._step_s > since_s:
                row[0] += step_s / self._step_s
            if self._rows and row[0] <= self._rows[-1][0]:
                self._join(row)
            else:
                self._rows.append(row)

    def _join(self, row: list[float]) -> None:
        last = self._rows[-1]
        count = last[1] + row[1]
        last[2:] = [
            (last[1] * a + row[1] * b) / count for a, b in zip(last[2:], row[2:], strict=True)
        ]
        last[1] = count

    def newest(self) -> float | None:
        """Preload of the newest step, percent; None if there is none."""
        return self._rows[-1][2] if self._rows else None

    def clear(self) -> None:
        """Begin anew."""
        self._step_s = self._first_step_s
        self._rows = []

    def points(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Times (s), preloads (percent), half widths (percent), distances (m), each (n,).

        The newest step is left out while it is less than half full: it would be noisier.
        """
        rows = np.array(self._rows, np.float64).reshape(-1, _COLUMNS)
        if len(rows) > 2 and rows[-1, 1] < 0.5 * np.median(rows[:, 1]):
            rows = rows[:-1]
        return (rows[:, 0] + 0.5) * self._step_s, rows[:, 2], rows[:, 3], rows[:, 4]

    def snapshot(self) -> PreloadSteps:
        """State that outlives the process."""
        return PreloadSteps(self._step_s, np.array(self._rows, np.float64).reshape(-1, _COLUMNS))

    def restore(self, snapshot: PreloadSteps) -> None:
        """Go on from a snapshot. Raises ValueError."""
        rows = snapshot.rows.reshape(-1, _COLUMNS)
        if not 0.0 < snapshot.step_s < _LONGEST_STEP_S:
            raise ValueError(f"a wear series with steps of {snapshot.step_s} s")
        if not np.all(np.isfinite(rows)) or np.any(np.diff(rows[:, 0]) <= 0):
            raise ValueError("a wear series out of order")
        self._step_s, self._rows = snapshot.step_s, rows.tolist()

    def _coarsen(self) -> None:
        rows = np.array(self._rows)
        number, first = np.unique(rows[:, 0] // 2.0, return_index=True)
        count = np.add.reduceat(rows[:, 1], first)
        means = np.add.reduceat(rows[:, 2:] * rows[:, 1:2], first, axis=0) / count[:, None]
        self._rows = np.column_stack([number, count, means]).tolist()
        self._step_s *= 2.0
