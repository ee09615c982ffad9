"""A screw that grows as it warms up; the sensor on the housing follows late."""

import numpy as np

from ..contribution import Contribution, Curve, Over, Strain, lagged_warming
from ..effect import Effect, Parameter, Role, Values, reference_temperature

EXPANSION_PER_K = 11.5e-6
"""Thermal expansion of screw steel."""


def _contributions(values: Values) -> tuple[Contribution, ...]:
    rise_k, time_constant_s = values["rise_k"], values["time_constant_s"]
    per_k, reference_c = values["strain_per_k"], values["reference_c"]
    parts: list[Contribution] = [lagged_warming(rise_k, time_constant_s)]
    if rise_k:
        parts.append(Strain(Over.TIME, _growth(rise_k, time_constant_s)))
    if per_k:
        parts.append(Strain(Over.TEMPERATURE, _grown(per_k, reference_c)))
    return tuple(parts)


def _grown(per_k: float, reference_c: float) -> Curve:
    return lambda temperature_c: per_k * (temperature_c - reference_c)


def _growth(rise_k: float, time_constant_s: float) -> Curve:
    return lambda time_s: -EXPANSION_PER_K * rise_k * np.expm1(-time_s / time_constant_s)


EFFECT = Effect(
    name="thermal_growth",
    description="The screw grows while it warms up and carries the table away from its bearing.",
    source=(
        "x = R theta (1 + alpha dT (1 - exp(-t / tau))), alpha = 11.5e-6 per K; where a "
        "temperature is recorded, growth in proportion to it"
    ),
    parameters=(
        Parameter("rise_k", "K", "Temperature rise of the screw at last.", -50.0, 100.0, 0.0, 10.0),
        Parameter(
            "strain_per_k",
            "1/K",
            "Growth for each K by which the housing is warmer than the reference.",
            -1e-4,
            1e-4,
            0.0,
            0.0,
        ),
        Parameter(
            "time_constant_s",
            "s",
            "Time for 63 % of the rise.",
            1.0,
            1e5,
            900.0,
            900.0,
            Role.SHAPE,
            amounts=("rise_k",),
        ),
        reference_temperature("strain_per_k"),
    ),
    contributions=_contributions,
)
