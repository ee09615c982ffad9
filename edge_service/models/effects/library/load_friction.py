"""Screw friction that grows with the load."""

from ..contribution import LoadFriction
from ..effect import Effect, Kind, amount, friction_share, viscous_share

EFFECT = Effect(
    name="load_friction",
    description="Friction grows with the force that the screw carries: its efficiency is low.",
    source="screw catalogues: a load T needs T / eta; torque s(v) mu |T_load|, mu = 1 / eta - 1",
    kind=Kind.FRICTION,
    parameters=(
        amount("coefficient", "1", "Friction torque divided by load torque.", 0.0, 0.9, 0.15),
        friction_share(),
        viscous_share(),
    ),
    contributions=lambda values: (
        LoadFriction(values["coefficient"], values["friction_share"], values["viscous_share"]),
    ),
)
