"""Friction that grows with the square of the speed."""

import numpy as np

from ..contribution import Contribution, Curve, Over, Side, SmoothTorque
from ..effect import Effect, Parameter, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = _quadratic(values["coefficient_nm_s2_per_rad2"])
    return (SmoothTorque(Over.SPEED, curve, Side.MOTOR),)


def _quadratic(coefficient_nm_s2_per_rad2: float) -> Curve:
    return lambda speed_rad_s: coefficient_nm_s2_per_rad2 * speed_rad_s * np.abs(speed_rad_s)


EFFECT = Effect(
    name="quadratic_friction",
    description="Friction soars at high speed: too much lubricant is churned.",
    source="drag of a churned fluid at high Reynolds numbers: torque E v |v|",
    parameters=(
        Parameter(
            "coefficient_nm_s2_per_rad2",
            "N m s^2/rad^2",
            "Torque over squared motor speed.",
            -1e-3,
            1e-2,
            0.0,
            1e-4,
        ),
    ),
    contributions=_contributions,
)
