"""Friction that wavers within each turn."""

from ..contribution import DryFriction, Over, Side
from ..effect import ACCELERATION_HZ, Effect, Kind, amount, harmonic, order, phase

EFFECT = Effect(
    name="once_per_rev_friction",
    description="Friction wavers with the turn: a bent screw, a damaged ball or bearing.",
    source="torque s(v) A sin(n theta + phi)",
    kind=Kind.FRICTION,
    parameters=(
        amount("amplitude_nm", "N m", "Amplitude.", -5.0, 5.0, 0.05),
        order(1.0, most=12),
        phase(),
    ),
    contributions=lambda values: (
        DryFriction(Over.ANGLE, harmonic(values, "amplitude_nm"), Side.MOTOR),
    ),
    least_rate_hz=ACCELERATION_HZ,
)
