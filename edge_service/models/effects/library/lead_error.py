"""A screw whose lead is not what it should be."""

import math

from ..contribution import Contribution, Curve, Over, Place, Shift, harmonic
from ..effect import Effect, Parameter, Role, Values, order, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    wobble = harmonic(values["amplitude_m"], values["order"], values["phase_rad"])
    return (
        Shift(Place.NUT, Over.ANGLE, wobble),
        Shift(Place.NUT, Over.POSITION, _stretched(values["pitch_error"])),
        Shift(Place.NUT, Over.POSITION, _slow(values)),
    )


def _stretched(pitch_error: float) -> Curve:
    return lambda position_m: pitch_error * position_m


def _slow(values: Values) -> Curve:
    """Variation over many turns, a wave along the travel."""
    amplitude, length = values["variation_m"], values["wavelength_m"]
    return harmonic(amplitude, 2.0 * math.pi / length, values["variation_phase_rad"])


EFFECT = Effect(
    name="lead_error",
    description="The screw's lead is off: the table wobbles once per turn or drifts with travel.",
    source="ISO 3408-3 travel deviation: x = R theta + A sin(n theta + phi) + eps x, and its "
    "variation B sin(2 pi x / L + psi)",
    parameters=(
        Parameter("amplitude_m", "m", "Wobble per turn.", -2e-4, 2e-4, 0.0, 4e-6),
        phase(amount="amplitude_m"),
        order(1.0, amount="amplitude_m"),
        Parameter("pitch_error", "m/m", "Travel too long, per travel.", -2e-3, 2e-3, 0.0, 3e-5),
        Parameter("variation_m", "m", "Variation over many turns.", -5e-4, 5e-4, 0.0, 0.0),
        phase("variation_phase_rad", "variation_m", "Where in the wavelength it begins."),
        Parameter(
            "wavelength_m",
            "m",
            "Length of one variation along the travel.",
            0.02,
            10.0,
            0.3,
            0.3,
            Role.SHAPE,
            amounts=("variation_m",),
        ),
    ),
    contributions=_contributions,
)
