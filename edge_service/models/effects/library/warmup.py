"""Friction that fades while the axis warms up; the sensor on the housing follows late."""

import numpy as np

from ..contribution import Contribution, Curve, DryFriction, Over, Side, lagged_warming
from ..effect import Effect, Parameter, Role, Values

WARM_RISE_K = 8.0
"""Assumption: what the housing warms up by while the friction falls; it is no measure of that."""


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = _fading(values["excess_nm"], values["time_constant_s"], values["of_cold"])
    rise_k = WARM_RISE_K if values["excess_nm"] else 0.0
    warming = lagged_warming(rise_k, values["time_constant_s"])
    return (DryFriction(Over.TIME, curve, Side.AS_DRAG), warming)


def _fading(excess_nm: float, time_constant_s: float, of_cold: float) -> Curve:
    return lambda time_s: excess_nm * (np.exp(-time_s / time_constant_s) - of_cold)


EFFECT = Effect(
    name="warmup",
    description="A cold axis rubs harder at first, and eases while its lubricant warms up.",
    source="seed, Figure 5.11: s(v) F exp(-t / tau), less F where the model is of the cold axis",
    parameters=(
        Parameter("excess_nm", "N m", "Coulomb level more when cold.", -5.0, 5.0, 0.0, 0.06),
        Parameter(
            "time_constant_s",
            "s",
            "Time in which it falls to 1/e.",
            1.0,
            1e5,
            1200.0,
            1200.0,
            Role.SHAPE,
        ),
        Parameter(
            "of_cold",
            "1",
            "1 where the model has the friction of the cold axis, 0 where of the warm one.",
            0.0,
            1.0,
            0.0,
            0.0,
            Role.SHAPE,
        ),
    ),
    contributions=_contributions,
)
