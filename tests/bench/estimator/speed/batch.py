"""Many axes' phases in one compiled call: the estimator without Python between its steps."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.typed import List

from edge_service.estimate.mixture.state import AxisModel, Bank, Process, Reading
from edge_service.estimate.mixture.step import step
from edge_service.messages.samples import Floats
from edge_service.models.compiled import compiled

READING_SIZE = len(Reading._fields)


class MixtureBatch:
    """The filters of n axes, each with model and process of its own; no axis knows another.

    What is handed in is changed in place, so a batch goes on where its axes stand.
    """

    def __init__(self, axes: Iterable[tuple[Bank, AxisModel, Process]]) -> None:
        rows = list(axes)
        if not rows:
            raise ValueError("a batch needs an axis")
        self._banks, self._models, self._processes = map(List, zip(*rows, strict=True))
        self._count = len(rows)

    def step(self, axes: npt.NDArray[np.int64], readings: Floats, elapsed_s: Floats) -> Floats:
        """Take m phases in their order, as `step.step` would one by one.

        Args:
            axes: (m,) whose phase each is, 0 to n - 1.
            readings: (m, READING_SIZE), fields of `Reading`.
            elapsed_s: (m,) since the same axis' phase before.

        Returns:
            (m,) as `step` returns.

        Raises:
            ValueError: shapes that do not belong together, or an axis that is none.
        """
        rows = len(axes)
        if readings.shape != (rows, READING_SIZE) or len(elapsed_s) != rows:
            raise ValueError(f"{rows} phases, but other shapes: {readings.shape}")
        if rows and not (axes.min() >= 0 and axes.max() < self._count):
            raise ValueError(f"axes are 0 to {self._count - 1}")
        return take_many(self._banks, self._models, self._processes, axes, readings, elapsed_s)


@compiled
def take_many(
    banks: Any,
    models: Any,
    processes: Any,
    axes: npt.NDArray[np.int64],
    readings: Floats,
    elapsed_s: Floats,
) -> Floats:
    """See MixtureBatch.step; nothing is checked here."""
    nis = np.empty(len(axes))
    for row in range(len(axes)):
        i, r = axes[row], readings[row]
        reading = Reading(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7] > 0.0)
        nis[row] = step(banks[i], models[i], processes[i], reading, elapsed_s[row])
    return nis
