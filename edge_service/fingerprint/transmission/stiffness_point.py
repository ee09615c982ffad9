"""Findings from the stretch at one place of the stroke: stiffness, resonance, lost motion, play."""

import math
from dataclasses import dataclass, replace

from ...models.machine import Quantity
from ...regression.interval_estimate import IntervalEstimate, normal_quantile, undetermined

MASS_UNKNOWN = "needs the table's mass (model.table_mass_kg)"


@dataclass(frozen=True, slots=True)
class StiffnessPoint:
    """The axis at one place of its stroke.

    Attributes:
        position_m: of the table.
        stiffness: of all springs in series, N/m.
        locked_resonance: of the table against a motor that is held, Hz: 1 / (2 pi sqrt(C m));
            known without the mass.
        lost_motion: difference of the stretch between the two directions, m: wind-up by the guide
            force, and backlash.
    """

    position_m: float
    stiffness: IntervalEstimate
    locked_resonance: IntervalEstimate
    lost_motion: IntervalEstimate


def backlash(
    point: StiffnessPoint, guide_force_n: Quantity | None, play: IntervalEstimate | None = None
) -> IntervalEstimate:
    """Play at one place: the lost motion less the wind-up 2 F_guide C that the guides cause, m.

    Without a known guide force it is the play that shows by itself. Where none does, the two cannot
    be told apart, and the interval runs from no play to all of the lost motion.
    """
    lost, stiffness = point.lost_motion, point.stiffness
    if play is not None and play.determined and guide_force_n is None:
        return play
    if not lost.determined:
        return undetermined("m", lost.note, lost.n_effective)
    if guide_force_n is None or not stiffness.determined or stiffness.low <= 0.0:
        note = "wind-up and play cannot be told apart without the guide force and the stiffness"
        return IntervalEstimate(math.nan, 0.0, max(lost.high, 0.0), "m", lost.n_effective, note)
    windup = 2.0 * guide_force_n.value / stiffness.value
    sigma = math.hypot(
        lost.sigma,
        2.0 * guide_force_n.sigma / stiffness.value,
        windup * stiffness.sigma / stiffness.value,
    )
    value, half = lost.value - windup, normal_quantile() * sigma
    return IntervalEstimate(
        max(value, 0.0), max(value - half, 0.0), max(value + half, 0.0), "m", lost.n_effective
    )


def stiffness_of(compliance: IntervalEstimate, table_mass_kg: Quantity | None) -> IntervalEstimate:
    """1 / C with the tolerance of the mass, N/m."""
    if table_mass_kg is None:
        return undetermined("N/m", MASS_UNKNOWN, compliance.n_effective)
    inverse = _reciprocal(compliance, "N/m")
    spread = normal_quantile() * table_mass_kg.tolerance
    if not inverse.low > 0.0 or spread == 0.0:
        return inverse
    below = math.hypot(inverse.value / inverse.low - 1.0, spread)
    above = math.hypot(inverse.high / inverse.value - 1.0, spread)
    return replace(inverse, low=inverse.value / (1.0 + below), high=inverse.value * (1.0 + above))


def _reciprocal(positive: IntervalEstimate, unit: str) -> IntervalEstimate:
    """1 / x where x is positive by its nature and its estimate may not be."""
    count = positive.n_effective
    if not positive.determined:
        return undetermined(unit, positive.note, count)
    if positive.high <= 0.0:
        return undetermined(unit, "no compliance seen: encoders or signs disagree", count)
    if positive.low > 0.0:
        low, high = 1.0 / positive.high, 1.0 / positive.low
        return IntervalEstimate(1.0 / positive.value, low, high, unit, count)
    value = 1.0 / positive.value if positive.value > 0.0 else math.nan
    note = "too stiff for this recording: only a lower bound is known"
    return IntervalEstimate(value, 1.0 / positive.high, math.inf, unit, count, note)


def locked_resonance(load: IntervalEstimate, mass_kg: float) -> IntervalEstimate:
    """1 / (2 pi sqrt(C m)), Hz; `load` is C, and the mass with which it was fitted cancels."""
    inverse = _reciprocal(load, "1/s^2").scaled(1.0 / mass_kg, "1/s^2")
    low, value, high = (
        math.sqrt(bound) / (2.0 * math.pi) if bound > 0.0 else bound
        for bound in (inverse.low, inverse.value, inverse.high)
    )
    return IntervalEstimate(value, low, high, "Hz", inverse.n_effective, inverse.note)
