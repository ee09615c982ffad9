"""Use of the screw: travel, hours, reversals, load spectrum, and where along the stroke."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...messages.trend import Use

FORCE_EDGES_N = (0.0, 50.0, 100.0, 200.0, 350.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0)
_PARTS = 40


@dataclass(frozen=True, slots=True)
class ScrewGeometry:
    """Geometry that turns angles and torques into travel and forces."""

    ratio_m_per_rad: float  # way per angle of the motor, m/rad
    stroke_m: float | None  # length of the stroke; None: there is no map


class UsageCounter:
    """Counts what every usable interval of one axis adds."""

    def __init__(self, geometry: ScrewGeometry, now_ns: int) -> None:
        self._ratio, self._stroke_m = geometry.ratio_m_per_rad, geometry.stroke_m
        self.restart(now_ns)

    def restart(self, now_ns: int) -> None:
        """Begin anew: a new part came into use."""
        self._since_ns = now_ns
        self._moving_s = self._observed_s = self.distance_m = 0.0
        self._reversals = 0
        self._way_m: Floats = np.zeros(_PARTS if self._stroke_m else 0)
        self._force_way_m: Floats = np.zeros(len(FORCE_EDGES_N) - 1)

    def add(self, block: FeatureBlock) -> None:
        """Count one interval; unusable ones are left out.

        Turning round inside an interval is its straight way: less than was worked.
        """
        if not block.usable or not math.isfinite(block.moving_fraction):
            return
        self._observed_s += block.duration_s
        self._moving_s += block.moving_fraction * block.duration_s
        self._reversals += block.reversal_count
        way_m = abs(block.angle_end_rad - block.angle_start_rad) * self._ratio
        if not math.isfinite(way_m):
            way_m = abs(block.table_end_m - block.table_start_m)
        if not way_m > 0.0:
            return
        self.distance_m += way_m
        place_m = block.table_mean_m
        if not math.isfinite(place_m):
            place_m = block.angle_mean_rad * self._ratio
        if self._stroke_m and math.isfinite(place_m):
            part = int(place_m / self._stroke_m * _PARTS)
            self._way_m[min(max(part, 0), _PARTS - 1)] += way_m
        force_n = abs(block.torque_mean_nm) / self._ratio
        if math.isfinite(force_n):
            part = int(np.searchsorted(FORCE_EDGES_N, force_n, side="right")) - 1
            self._force_way_m[min(part, self._force_way_m.size - 1)] += way_m

    def use(self) -> Use:
        return Use(
            since_time_ns=self._since_ns,
            moving_s=self._moving_s,
            observed_s=self._observed_s,
            distance_m=self.distance_m,
            reversals=self._reversals,
            stroke_from_m=0.0,
            stroke_to_m=self._stroke_m or 0.0,
            way_m=tuple(round(each, 3) for each in self._way_m.tolist()),
            force_edges_n=FORCE_EDGES_N,
            force_way_m=tuple(round(each, 3) for each in self._force_way_m.tolist()),
        )

    def restore(self, use: Use, step_ns: int = 0) -> None:
        """Go on from what was counted by a clock that was set by a step since, ns."""
        self._since_ns, self._moving_s = use.since_time_ns + step_ns, use.moving_s
        self._observed_s, self.distance_m = use.observed_s, use.distance_m
        self._reversals = use.reversals
        if len(use.way_m) == self._way_m.size:
            self._way_m = np.array(use.way_m)
        if len(use.force_way_m) == self._force_way_m.size:
            self._force_way_m = np.array(use.force_way_m)
