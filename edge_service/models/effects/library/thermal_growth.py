"""A screw that grows as it warms up; the sensor on the housing follows late."""

import numpy as np

from ..contribution import Contribution, Curve, Strain, lagged_warming
from ..effect import Effect, Parameter, Role, Values

EXPANSION_PER_K = 11.5e-6
"""Thermal expansion of screw steel."""


def _contributions(values: Values) -> tuple[Contribution, ...]:
    rise_k, time_constant_s = values["rise_k"], values["time_constant_s"]
    return (Strain(_growth(rise_k, time_constant_s)), lagged_warming(rise_k, time_constant_s))


def _growth(rise_k: float, time_constant_s: float) -> Curve:
    return lambda time_s: -EXPANSION_PER_K * rise_k * np.expm1(-time_s / time_constant_s)


EFFECT = Effect(
    name="thermal_growth",
    description="The screw grows while it warms up and carries the table away from its bearing.",
    source="x = R theta (1 + alpha dT (1 - exp(-t / tau))), alpha = 11.5e-6 per K",
    parameters=(
        Parameter("rise_k", "K", "Temperature rise of the screw at last.", -50.0, 100.0, 0.0, 10.0),
        Parameter(
            "time_constant_s", "s", "Time for 63 % of the rise.", 1.0, 1e5, 900.0, 900.0, Role.SHAPE
        ),
    ),
    contributions=_contributions,
)
