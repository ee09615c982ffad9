"""Dry friction that is higher at low speed."""

from ....messages.samples import Floats
from ...screw.friction import stribeck_decay
from ..contribution import Contribution, DryFriction, Over, Side
from ..effect import Effect, Parameter, Role, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    excess_nm, scale, exponent = values["excess_nm"], values["speed_rad_s"], values["exponent"]

    def excess(speed_rad_s: Floats) -> Floats:
        return excess_nm * stribeck_decay(speed_rad_s, scale, exponent)

    return (DryFriction(Over.SPEED, excess, Side.MOTOR),)


EFFECT = Effect(
    name="stribeck",
    description="Friction rises at low speed and the axis breaks away hard: lubrication is thin.",
    source="Armstrong-Helouvry (1991), the exponential form of the seed's (5.3.13)",
    parameters=(
        Parameter("excess_nm", "N m", "Breakaway above Coulomb level.", -5.0, 5.0, 0.0, 0.2),
        Parameter(
            "speed_rad_s",
            "rad/s",
            "Motor speed at which the excess has fallen to 1/e.",
            0.01,
            100.0,
            2.0,
            2.0,
            Role.SHAPE,
        ),
        Parameter("exponent", "1", "Steepness of the fall.", 0.5, 4.0, 2.0, 2.0, Role.SHAPE),
    ),
    contributions=_contributions,
)
