"""Means over the phases of steady motion of an interval."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..messages.features import PHASES, Phase
from ..messages.samples import Floats
from . import interval_kernels as kernels
from .interval_rows import IntervalRows


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """Criteria for rows of steady motion.

    Attributes:
        gate_s: time after a reversal or a start that is left out (presliding, wind-up).
        min_speed_rad_s: slower rows are left out (Stribeck friction, creeping jogs).
        cruise_rad_s2: up to this acceleration the axis cruises.
        even_share: rows whose window is less even than this are left out (a hole in it).
    """

    gate_s: float = 0.05
    min_speed_rad_s: float = 2.0
    cruise_rad_s2: float = 30.0
    even_share: float = 0.2

    @property
    def limits(self) -> Floats:
        """The criteria as the arithmetic takes them, (4,)."""
        return np.array([self.gate_s, self.min_speed_rad_s, self.cruise_rad_s2, self.even_share])


def steady_phases(
    interval: IntervalRows, since_s: Floats, has_table: bool, settings: PhaseSettings
) -> dict[str, Any]:
    """Direction and phases of an interval, as fields of FeatureBlock.

    Args:
        interval: its rows.
        since_s: (end - first,), when the motion of each row began, s; inf at standstill.
        has_table: the linear encoder may be read.
        settings: criteria of steady motion.
    """
    direction, found = kernels.phases(
        interval.segment, interval.first, interval.end, interval.reach, since_s, settings.limits
    )
    if direction == 0.0:
        return {}
    if not has_table:
        found[:, -1] = math.nan
    rows = zip(PHASES, found.tolist(), strict=True)
    return {"steady_direction": direction} | {name: Phase(*row) for name, row in rows if row[0]}
