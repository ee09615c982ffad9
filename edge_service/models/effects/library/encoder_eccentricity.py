"""A rotary encoder that sits off its centre."""

from ..contribution import Over, Place, Shift
from ..effect import ACCELERATION_HZ, Effect, Kind, amount, harmonic, order, phase

EFFECT = Effect(
    name="encoder_eccentricity",
    description="The motor's encoder disc sits off centre and misreads the angle within each turn.",
    source="measured theta + r, r = A sin(n theta + phi): x - R theta by -R r, torque -J r''",
    kind=Kind.MEASUREMENT,
    parameters=(
        amount("amplitude_rad", "rad", "Amplitude.", -0.05, 0.05, 1e-3),
        phase(),
        order(1.0, most=3),
    ),
    contributions=lambda values: (
        Shift(Place.ANGLE_READING, Over.ANGLE, harmonic(values, "amplitude_rad")),
    ),
    least_rate_hz=ACCELERATION_HZ,
)
