"""Dry friction that is higher at low speed."""

from collections.abc import Iterator

import numpy as np

from ....messages.samples import Floats
from ...screw.friction import stribeck_decay
from ..baseline import Baseline
from ..contribution import Contribution, DryFriction, Over, Side
from ..effect import Effect, Kind, Trace, Values, amount, shape
from ..empirical import Covered, EmpiricalForm, MotionCurve, lagging
from ..hysteresis import bristle_share

_FILM_S = (0.1, 0.3)
"""A film follows the speed within these (Hess and Soom, 1990): friction lags behind speed."""


def _contributions(values: Values) -> tuple[Contribution, ...]:
    excess_nm, scale, exponent = values["excess_nm"], values["speed_rad_s"], values["exponent"]

    def excess(speed_rad_s: Floats) -> Floats:
        return excess_nm * stribeck_decay(speed_rad_s, scale, exponent)

    return (DryFriction(Over.SPEED, excess, Side.MOTOR),)


def _empirical_forms(_covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    """Breakaway that builds up over the first micrometre, or under a film that is late."""
    for speed_rad_s in np.geomspace(0.3, 30.0, 8).tolist():
        yield EmpiricalForm("late", (_presliding_excess(speed_rad_s),))
        for film_s in _FILM_S:
            yield EmpiricalForm("film", (_late_excess(speed_rad_s, film_s),))


def _late_excess(speed_rad_s: float, film_s: float) -> MotionCurve:
    return lambda motion, _: (
        motion.direction
        * np.exp(-lagging(motion, film_s, np.abs(motion.speed_rad_s)) / speed_rad_s)
    )


def _presliding_excess(speed_rad_s: float) -> MotionCurve:
    return lambda motion, baseline: (
        bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, 1e-6)
        * np.exp(-np.abs(motion.speed_rad_s) / speed_rad_s)
    )


EFFECT = Effect(
    name="stribeck",
    description="Friction rises at low speed and the axis breaks away hard: lubrication is thin.",
    source="Armstrong-Helouvry (1991), the exponential form of the thesis' eq. 5.3.13",
    kind=Kind.FRICTION,
    parameters=(
        amount("excess_nm", "N m", "Breakaway above Coulomb level.", -5.0, 5.0, 0.2),
        shape(
            "speed_rad_s", "rad/s", "Speed at which the excess has fallen to 1/e.", 0.01, 100.0, 2.0
        ),
        shape("exponent", "1", "Steepness of the fall.", 0.5, 4.0, 2.0, tried=(1.0, 2.0)),
    ),
    contributions=_contributions,
    imitates=frozenset({"presliding", "quadratic_friction"}),
    most_shapes=2,
    most_entries=1,
    trace=Trace(  # dry friction is a few percent higher at a creep
        lambda _period_s, coulomb_nm: (0.0, max(0.05 * coulomb_nm, 1e-9)),
        {"speed_rad_s": 1.5, "exponent": 1.0},
    ),
    empirical_forms=_empirical_forms,
)
