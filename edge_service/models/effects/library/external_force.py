"""A force on the table that nobody recorded."""

import numpy as np

from ....messages.samples import Floats
from ..contribution import Contribution, TableForce
from ..effect import Effect, Kind, Values, amount, shape


def _contributions(values: Values) -> tuple[Contribution, ...]:
    start_s, end_s = values["start_s"], values["start_s"] + values["duration_s"]

    def pulse(time_s: Floats) -> Floats:
        return np.where((time_s >= start_s) & (time_s < end_s), values["force_n"], 0.0)

    return (TableForce(pulse),)


EFFECT = Effect(
    name="external_force",
    description="Something pushes the table for a while: a cut, a hose, a person.",
    source="thesis, Figure 5.14 (disturbance force): torque -R F(t), x - R theta by F(t) / K",
    kind=Kind.DISTURBANCE,
    parameters=(
        amount("force_n", "N", "Force, positive along the axis.", -1e5, 1e5, 200.0),
        shape("start_s", "s", "Time at which it begins.", 0.0, 1e7, 1.0),
        shape("duration_s", "s", "Duration.", 1e-3, 1e7, 5.0),
    ),
    contributions=_contributions,
    most_shapes=10,
)
