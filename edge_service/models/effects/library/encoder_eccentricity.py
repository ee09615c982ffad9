"""A rotary encoder that sits off its centre."""

from ..contribution import Contribution, Harmonic, Over, Place, Shift
from ..effect import ACCELERATION_HZ, Effect, Kind, Parameter, Values, order, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = Harmonic(values["amplitude_rad"], values["order"], values["phase_rad"])
    return (Shift(Place.ANGLE_READING, Over.ANGLE, curve),)


EFFECT = Effect(
    name="encoder_eccentricity",
    description="The motor's encoder disc sits off centre and misreads the angle within each turn.",
    source="measured theta + r, r = A sin(n theta + phi): x - R theta by -R r, torque -J r''",
    kind=Kind.MEASUREMENT,
    parameters=(
        Parameter("amplitude_rad", "rad", "Amplitude.", -0.05, 0.05, 0.0, 1e-3),
        phase(),
        order(1.0, most=3),
    ),
    contributions=_contributions,
    least_rate_hz=ACCELERATION_HZ,
)
