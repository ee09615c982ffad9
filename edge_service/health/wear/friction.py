"""The friction curve that ordinary work shows, against the one from when the part was new."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...messages.stored import StoredFloats
from ...messages.trend import FrictionCurve

_STEPS = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0])
EDGES_RAD_S: Floats = np.concatenate([-_STEPS[::-1], _STEPS])
_STEADY_SHARE = 0.03
_SETTLED_S = 0.2
_BASELINE_COUNT = 100.0
_MEMORY_COUNT = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class FrictionClasses:
    """Count, recent count, mean speed, newest and first torque by class of speed, (5, n)."""

    columns: StoredFloats


class FrictionWatch:
    """Mean torque at steady speed per class of speed: of the first intervals, and of the newest.

    At steady speed the torque is friction and load alone; a vertical or pushed axis shows its load
    here as well.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Begin anew: a new part came into use."""
        self._columns: Floats = np.zeros((5, EDGES_RAD_S.size - 1))
        self._count, self._recent, self._speed, self._now, self._first = self._columns

    def restart_newest(self) -> None:
        """The axis changed suddenly: what was before is no longer what is now."""
        seen = self._count > 0.0
        self._count[seen] = np.maximum(self._count[seen], _BASELINE_COUNT)
        self._recent[:] = 0.0

    def add(self, block: FeatureBlock) -> None:
        """Take an interval in; only those at steady speed count."""
        speed = 0.5 * (block.speed_start_rad_s + block.speed_end_rad_s)
        k = int(np.searchsorted(EDGES_RAD_S, speed, side="right")) - 1
        is_class = 0 <= k < self._count.size and EDGES_RAD_S[k] != -1.0
        if not is_class or not _steady(block, speed):
            return
        self._count[k] += 1.0
        self._recent[k] = min(self._recent[k] + 1.0, _MEMORY_COUNT)
        self._speed[k] += (speed - self._speed[k]) / self._recent[k]
        self._now[k] += (block.torque_mean_nm - self._now[k]) / self._recent[k]
        if self._count[k] <= _BASELINE_COUNT:
            self._first[k] += (block.torque_mean_nm - self._first[k]) / self._count[k]

    def curve(self) -> FrictionCurve:
        """Classes of speed that were seen lately, most negative first."""
        seen = self._recent > 0.0
        return FrictionCurve(
            speed_rad_s=_rounded(self._speed[seen]),
            torque_nm=_rounded(self._now[seen]),
            first_torque_nm=_rounded(self._first[seen]),
            count=tuple(int(each) for each in self._count[seen]),
        )

    def snapshot(self) -> FrictionClasses:
        """State that outlives the process."""
        return FrictionClasses(self._columns.copy())

    def restore(self, snapshot: FrictionClasses) -> None:
        """Go on from a snapshot. Raises ValueError."""
        if snapshot.columns.shape != self._columns.shape:
            raise ValueError("a friction curve of another version")
        self._columns[:] = snapshot.columns


def _steady(block: FeatureBlock, speed_rad_s: float) -> bool:
    change = abs(block.speed_end_rad_s - block.speed_start_rad_s)
    return (
        block.usable
        and block.reversal_count == 0
        and block.since_reversal_s >= _SETTLED_S
        and change <= max(_STEADY_SHARE * abs(speed_rad_s), 0.2)
        and math.isfinite(block.torque_mean_nm)
    )


def _rounded(values: Floats) -> tuple[float, ...]:
    return tuple(float(f"{each:.5g}") for each in values)
