"""A stretch of the stroke that runs harder."""

import math

import numpy as np

from ....messages.samples import Floats
from ..contribution import Contribution, DryFriction, Over, Side
from ..effect import Effect, Kind, Values, amount, shape


def _contributions(values: Values) -> tuple[Contribution, ...]:
    excess_nm, centre_m = values["excess_nm"], values["centre_m"]
    sharpness = 4.0 * math.log(2.0) / values["width_m"] ** 2

    def bump(position_m: Floats) -> Floats:
        return excess_nm * np.exp(-sharpness * (position_m - centre_m) ** 2)

    return (DryFriction(Over.POSITION, bump, Side.TABLE),)


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
