"""Means over the phases of steady motion of an interval."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..messages.features import PHASES, Phase
from ..messages.samples import Floats
from .interval_rows import IntervalRows
from .rows import THETA, T, U, X


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


def steady_phases(
    interval: IntervalRows, since_s: Floats, has_table: bool, settings: PhaseSettings
) -> dict[str, Any]:
    """Direction and phases of an interval, as fields of FeatureBlock.

    Acceleration is the divided second difference over `reach` rows on either side, which is the
    mean of the true acceleration under a triangular window; torque goes through the same window.

    Args:
        interval: its rows.
        since_s: (end - first,), when the motion of each row began, s; inf at standstill.
        has_table: the linear encoder may be read.
        settings: criteria of steady motion.
    """
    segment, first, reach = interval.segment, interval.first, interval.reach
    rows = np.arange(max(first, reach), min(interval.end, len(segment) - reach))
    if not len(rows):
        return {}
    before, here, behind = segment[rows - reach], segment[rows], segment[rows + reach]
    span = behind[:, T] - before[:, T]
    half = 0.5 * span
    speed = (behind[:, THETA] - before[:, THETA]) / span
    came = (here[:, THETA] - before[:, THETA]) / (here[:, T] - before[:, T])
    goes = (behind[:, THETA] - here[:, THETA]) / (behind[:, T] - here[:, T])
    acceleration = (goes - came) / half
    moving_s = before[:, T] - since_s[rows - first]
    steady = (moving_s >= settings.gate_s) & (np.abs(speed) >= settings.min_speed_rad_s)
    steady &= np.abs(here[:, T] - before[:, T] - half) <= settings.even_share * half
    steady &= (np.sign(came) == np.sign(speed)) & (np.sign(goes) == np.sign(speed))
    if not steady.any():
        return {}
    direction = 1.0 if np.count_nonzero(speed[steady] > 0.0) * 2 >= steady.sum() else -1.0
    steady &= speed * direction > 0.0
    torque = _windowed(segment, rows, reach)
    along = acceleration * direction
    parts = (
        along > settings.cruise_rad_s2,
        np.abs(along) <= settings.cruise_rad_s2,
        along < -settings.cruise_rad_s2,
    )
    period_s = float(np.median(span)) / (2.0 * reach)
    table = here[:, X] if has_table else np.full(len(rows), np.nan)
    columns = np.column_stack([torque, acceleration, speed, here[:, THETA], table])
    phases = {
        name: Phase(float(np.count_nonzero(chosen)) * period_s, *columns[chosen].mean(axis=0))
        for name, part in zip(PHASES, parts, strict=True)
        if (chosen := steady & part).any()
    }
    return {"steady_direction": direction, **phases}


def _windowed(segment: Floats, rows: npt.NDArray[np.int64], reach: int) -> Floats:
    """Torque, held from row to row, under the triangular window of the second difference, (n,).

    The window rises from the row `reach` before to the row itself and falls to the row `reach`
    behind, whether or not they are evenly spaced.
    """
    around = rows[:, None] + np.arange(-reach, reach + 1)
    time_s = segment[around, T]
    begin, middle, end = time_s[:, :1], time_s[:, reach : reach + 1], time_s[:, -1:]
    rising = (time_s - begin) ** 2 / ((end - begin) * (middle - begin))
    falling = 1.0 - (end - time_s) ** 2 / ((end - begin) * (end - middle))
    below = np.where(time_s <= middle, rising, falling)
    weights = np.diff(below, axis=1)
    return np.asarray(np.sum(weights * segment[around[:, :-1], U], axis=1))
