"""A motor whose torque wavers with its angle."""

from ..contribution import Contribution, Harmonic, Over, Side, SmoothTorque
from ..effect import ACCELERATION_HZ, Effect, Kind, Parameter, Trace, Values, order, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = Harmonic(values["amplitude_nm"], values["order"], values["phase_rad"])
    return (SmoothTorque(Over.ANGLE, curve, Side.MOTOR),)


EFFECT = Effect(
    name="torque_ripple",
    description="The motor's torque wavers within each turn: cogging, or a fault of its windings.",
    source="torque A sin(n theta + phi), whatever the direction",
    kind=Kind.DRIVE,
    parameters=(
        Parameter("amplitude_nm", "N m", "Amplitude.", -5.0, 5.0, 0.0, 0.1),
        order(6.0),
        phase(),
    ),
    contributions=_contributions,
    least_rate_hz=ACCELERATION_HZ,
    trace=Trace(ranges={"amplitude_nm": (0.0, 0.01)}),
)
