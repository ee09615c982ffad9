"""Friction that grows with the square of the speed."""

from collections.abc import Iterator

import numpy as np

from ..baseline import Baseline
from ..contribution import Contribution, Over, Side, SmoothTorque
from ..effect import Effect, Kind, Values, amount
from ..empirical import Covered, EmpiricalForm, MotionCurve


def _contributions(values: Values) -> tuple[Contribution, ...]:
    share = values["coefficient_nm_s2_per_rad2"]
    return (SmoothTorque(Over.SPEED, lambda v: share * v * np.abs(v), Side.MOTOR),)


def _empirical_forms(_covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    for power in (1.4, 1.6, 1.8, 2.4, 3.0):
        yield EmpiricalForm("power", (_power_law(power),))


def _power_law(power: float) -> MotionCurve:
    return lambda motion, _: motion.direction * np.power(np.abs(motion.speed_rad_s) / 100.0, power)


EFFECT = Effect(
    name="quadratic_friction",
    description="Friction soars at high speed: too much lubricant is churned.",
    source="drag of a churned fluid at high Reynolds numbers: torque E v |v|",
    kind=Kind.FRICTION,
    parameters=(
        amount(
            "coefficient_nm_s2_per_rad2",
            "N m s^2/rad^2",
            "Torque divided by the square of the motor speed.",
            -1e-3,
            1e-2,
            1e-4,
        ),
    ),
    contributions=_contributions,
    imitates=frozenset({"presliding", "stribeck"}),
    empirical_forms=_empirical_forms,
)
