"""A force on the table that nobody recorded."""

import numpy as np

from ..contribution import Contribution, Curve, TableForce
from ..effect import Effect, Kind, Parameter, Role, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (TableForce(_pulse(values["force_n"], values["start_s"], values["duration_s"])),)


def _pulse(force_n: float, start_s: float, duration_s: float) -> Curve:
    return lambda time_s: np.where(
        (time_s >= start_s) & (time_s < start_s + duration_s), force_n, 0.0
    )


EFFECT = Effect(
    name="external_force",
    description="Something pushes the table for a while: a cut, a hose, a person.",
    source="thesis, Figure 5.14 (disturbance force): torque -R F(t), x - R theta by F(t) / K",
    kind=Kind.DISTURBANCE,
    parameters=(
        Parameter("force_n", "N", "Force, positive along the axis.", -1e5, 1e5, 0.0, 200.0),
        Parameter("start_s", "s", "Time at which it begins.", 0.0, 1e7, 1.0, 1.0, Role.SHAPE),
        Parameter("duration_s", "s", "Duration.", 1e-3, 1e7, 5.0, 5.0, Role.SHAPE),
    ),
    contributions=_contributions,
    most_shapes=10,
)
