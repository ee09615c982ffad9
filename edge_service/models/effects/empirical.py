"""Forms of an effect on a real axis beyond those of its few parameters, and curves they share.

A real screw does not warm up by an exponential of time alone, and play closes late: without these
forms what an entry cannot follow would be blamed on another effect.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from .baseline import Baseline, Motion
from .hysteresis import bristle_share

MotionCurve = Callable[[Motion, Baseline], Floats]
"""A function of measured motion, (n,), at unit strength."""
TABLE_SHARES = (0.4, 0.8)
"""Shares of the dry friction that may act on the table."""


@dataclass(frozen=True, slots=True)
class EmpiricalForm:
    """Columns that an effect may add to a gap; one in each of both has one amount for the two."""

    name: str  # what tells it from what are no mere other shapes of it
    # torque, transmission: curves in N m, and in m of x - R theta
    torque: tuple[MotionCurve, ...] = ()
    transmission: tuple[MotionCurve, ...] = ()


@dataclass(frozen=True, slots=True)
class Covered:
    """Time and travel that a recording covers; the travel is never 0."""

    duration_s: float
    low_m: float
    span_m: float

    @property
    def time_constants_s(self) -> tuple[float, ...]:
        """Time constants of a warm-up that it may show."""
        return tuple(share * self.duration_s for share in (0.1, 0.3, 1.0))


def heat(motion: Motion, time_constant_s: float, source: Floats | None = None) -> Floats:
    """First-order warmth by the motion, or a source in it, 1 at the mean when warm, (n,)."""
    source = np.abs(motion.speed_rad_s) if source is None else source
    return lagging(motion, time_constant_s, source) / max(float(source.mean()), 1e-9)


def lagging(motion: Motion, time_constant_s: float, source: Floats) -> Floats:
    """A series (n,) in the motion behind a first-order lag."""
    from scipy.signal import lfilter  # 45 MB that a service without a diagnosis does without

    period_s = float(motion.time_s[1] - motion.time_s[0])
    keep = float(np.exp(-period_s / time_constant_s))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], source))


def delayed_friction(reach_m: float, share: float) -> MotionCurve:
    """The table's friction comes late where the motor has to turn before the table moves."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        held = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, reach_m)
        return share * baseline.coulomb_nm * (held - motion.direction)

    return curve
