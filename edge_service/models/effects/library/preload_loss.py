"""Loss of preload: the screw's drag falls, and its nut gives more, by the nut's law."""

import numpy as np

from ....messages.samples import Floats
from ...screw.nut_law import nut_stiffness
from ..contribution import Change, Constant, Contribution, DryFriction, Over, Side
from ..effect import Effect, Kind, Parameter, Role, Values, shape


def _contributions(values: Values) -> tuple[Contribution, ...]:
    drag_nm, fresh_percent = values["fresh_drag_nm"], values["fresh_percent"]

    def drag_change_nm(time_s: Floats) -> Floats:
        return -drag_nm / 100.0 * lost_percent(values, time_s)

    left_percent = fresh_percent * (1.0 - values["lost_percent"] / 100.0)
    softer = nut_stiffness(1.0, fresh_percent) / nut_stiffness(1.0, left_percent) - 1.0
    return (
        DryFriction(Over.TIME, drag_change_nm, Side.MOTOR),
        Change(Constant.COMPLIANCE, values["fresh_nut_m_per_n"] * softer),
    )


def lost_percent(values: Values, time_s: Floats) -> Floats:
    """Loss at some times (n,), percent of the fresh preload: to its end at an even rate."""
    before_s = np.maximum(values["until_s"] - time_s, 0.0)
    lost: Floats = values["lost_percent"] - values["percent_per_s"] * before_s
    return np.clip(lost, 0.0, 100.0)


EFFECT = Effect(
    name="preload_loss",
    description="The nut clamps its balls less than when it was fresh: the screw is worn.",
    source="thesis (4.3.6), (5.3.11): drag in proportion to preload, stiffness by its cube root",
    kind=Kind.FRICTION,
    parameters=(
        Parameter(
            "lost_percent",
            "%",
            "Preload lost, as a share of the fresh screw's.",
            0.0,
            100.0,
            0.0,
            60.0,
            Role.SHAPE,
        ),
        shape("percent_per_s", "%/s", "Rate at which it was lost, per second.", 0.0, 1e3, 0.0),
        shape("until_s", "s", "Time at which the loss is complete.", -1e9, 1e9, 0.0),
        shape("fresh_drag_nm", "N m", "Drag of the fresh screw.", 0.0, 1e3, 0.146),
        shape(
            "fresh_percent", "%", "Fresh preload, as a share of the load rating.", 0.01, 100.0, 6.85
        ),
        shape("fresh_nut_m_per_n", "m/N", "Compliance of the fresh nut.", 0.0, 1e-5, 8.9e-9),
    ),
    contributions=_contributions,
    most_shapes=1,
    most_entries=1,
    is_fault=True,
)
