"""Dry friction that is higher at low speed."""

import numpy as np

from ..contribution import Contribution, Curve, DryFriction, Over, Side
from ..effect import Effect, Parameter, Role, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = _excess(values["excess_nm"], values["speed_rad_s"], values["exponent"])
    return (DryFriction(Over.SPEED, curve, Side.MOTOR),)


def _excess(excess_nm: float, stribeck_speed_rad_s: float, exponent: float) -> Curve:
    """F_s exp(-(|omega| / omega_s)^delta), N m over the motor speed."""
    return lambda speed_rad_s: (
        excess_nm * np.exp(-(np.abs(speed_rad_s / stribeck_speed_rad_s) ** exponent))
    )


EFFECT = Effect(
    name="stribeck",
    description="Friction rises at low speed and the axis breaks away hard: lubrication is thin.",
    source="Armstrong-Helouvry (1991), the exponential form of the seed's (5.3.13)",
    parameters=(
        Parameter("excess_nm", "N m", "Breakaway above Coulomb level.", -5.0, 5.0, 0.0, 0.2),
        Parameter(
            "speed_rad_s",
            "rad/s",
            "Motor speed at which the excess has fallen to 1/e.",
            0.01,
            100.0,
            2.0,
            2.0,
            Role.SHAPE,
        ),
        Parameter("exponent", "1", "Steepness of the fall.", 0.5, 4.0, 2.0, 2.0, Role.SHAPE),
    ),
    contributions=_contributions,
)
