"""A rotary encoder that sits off its centre."""

from ..contribution import Contribution, Over, Place, Shift, harmonic
from ..effect import Effect, Parameter, Values, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = harmonic(values["amplitude_rad"], 1.0, values["phase_rad"])
    return (Shift(Place.ANGLE_READING, Over.ANGLE, curve),)


EFFECT = Effect(
    name="encoder_eccentricity",
    description="The motor's encoder disc sits off centre and misreads the angle once per turn.",
    source="theta_measured = theta + r, r = A sin(theta + phi): x - R theta by -R r, torque -J r''",
    parameters=(
        Parameter("amplitude_rad", "rad", "Amplitude.", -0.05, 0.05, 0.0, 1e-3),
        phase(),
    ),
    contributions=_contributions,
)
