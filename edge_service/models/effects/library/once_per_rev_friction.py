"""Friction that wavers within each turn."""

from ..contribution import Contribution, DryFriction, Harmonic, Over, Side
from ..effect import ACCELERATION_HZ, Effect, Kind, Parameter, Values, order, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = Harmonic(values["amplitude_nm"], values["order"], values["phase_rad"])
    return (DryFriction(Over.ANGLE, curve, Side.MOTOR),)


EFFECT = Effect(
    name="once_per_rev_friction",
    description="Friction wavers with the turn: a bent screw, a damaged ball or bearing.",
    source="torque s(v) A sin(n theta + phi)",
    kind=Kind.FRICTION,
    parameters=(
        Parameter("amplitude_nm", "N m", "Amplitude.", -5.0, 5.0, 0.0, 0.05),
        order(1.0, most=12),
        phase(),
    ),
    contributions=_contributions,
    least_rate_hz=ACCELERATION_HZ,
)
