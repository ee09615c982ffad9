"""A motor whose torque wavers with its angle."""

from ..contribution import Over, Side, SmoothTorque
from ..effect import ACCELERATION_HZ, Effect, Kind, amount, harmonic, order, phase

EFFECT = Effect(
    name="torque_ripple",
    description="The motor's torque wavers within each turn: cogging, or a fault of its windings.",
    source="torque A sin(n theta + phi), whatever the direction",
    kind=Kind.DRIVE,
    parameters=(
        amount("amplitude_nm", "N m", "Amplitude.", -5.0, 5.0, 0.1),
        order(6.0),
        phase(),
    ),
    contributions=lambda values: (
        SmoothTorque(Over.ANGLE, harmonic(values, "amplitude_nm"), Side.MOTOR),
    ),
    least_rate_hz=ACCELERATION_HZ,
)
