"""A stretch of the stroke that runs harder."""

import math

import numpy as np

from ..contribution import Contribution, Curve, DryFriction, Over, Side
from ..effect import Effect, Kind, Values, amount, shape


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = _bump(values["excess_nm"], values["centre_m"], values["width_m"])
    return (DryFriction(Over.POSITION, curve, Side.TABLE),)


def _bump(excess_nm: float, centre_m: float, width_m: float) -> Curve:
    """Gaussian of a full width at half height, N m over the table position."""
    sharpness = 4.0 * math.log(2.0) / width_m**2
    return lambda position_m: excess_nm * np.exp(-sharpness * (position_m - centre_m) ** 2)


EFFECT = Effect(
    name="position_friction",
    description="A part of the stroke runs harder: a worn, dirty, dented or misaligned stretch.",
    source="torque s(v) g(x), wind-up -R s(v) g(x) / K; g a Gaussian over the stroke",
    kind=Kind.FRICTION,
    parameters=(
        amount(
            "excess_nm", "N m", "Increase of the Coulomb level at the worst place.", -5.0, 5.0, 0.3
        ),
        shape("centre_m", "m", "Position of the worst place.", -10.0, 50.0, 0.4),
        shape(
            "width_m",
            "m",
            "Full width at half height.",
            2e-3,
            50.0,
            0.1,
            tried_of_travel=(0.06, 0.12, 0.25, 0.5),
        ),
    ),
    contributions=_contributions,
)
