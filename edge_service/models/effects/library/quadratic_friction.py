"""Friction that grows with the square of the speed."""

from collections.abc import Iterator

import numpy as np

from ..baseline import Baseline
from ..contribution import Over, Side, SmoothTorque
from ..effect import Effect, Kind, amount
from ..empirical import Covered, EmpiricalForm, MotionCurve

_AMOUNT = "coefficient_nm_s2_per_rad2"


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
            _AMOUNT, "N m s^2/rad^2", "Torque over the motor speed's square.", -1e-3, 1e-2, 1e-4
        ),
    ),
    contributions=lambda values: (
        SmoothTorque(Over.SPEED, lambda v: values[_AMOUNT] * v * np.abs(v), Side.MOTOR),
    ),
    imitates=frozenset({"presliding", "stribeck"}),
    empirical_forms=_empirical_forms,
)
