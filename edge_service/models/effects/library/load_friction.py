"""Screw friction that grows with the load."""

from ..contribution import Contribution, LoadFriction
from ..effect import Effect, Kind, Parameter, Values, friction_share, viscous_share


def _contributions(values: Values) -> tuple[Contribution, ...]:
    shares = values["friction_share"], values["viscous_share"]
    return (LoadFriction(values["coefficient"], *shares),)


EFFECT = Effect(
    name="load_friction",
    description="Friction grows with the force that the screw carries: its efficiency is low.",
    source="screw catalogues: a load T needs T / eta; torque s(v) mu |T_load|, mu = 1 / eta - 1",
    kind=Kind.FRICTION,
    parameters=(
        Parameter(
            "coefficient", "1", "Friction torque divided by load torque.", 0.0, 0.9, 0.0, 0.15
        ),
        friction_share(),
        viscous_share(),
    ),
    contributions=_contributions,
)
