"""A screw whose lead is not what it should be."""

from ..contribution import Contribution, Curve, Over, Place, Shift, harmonic
from ..effect import Effect, Parameter, Values, order, phase


def _contributions(values: Values) -> tuple[Contribution, ...]:
    wobble = harmonic(values["amplitude_m"], values["order"], values["phase_rad"])
    return (
        Shift(Place.NUT, Over.ANGLE, wobble),
        Shift(Place.NUT, Over.POSITION, _stretched(values["pitch_error"])),
    )


def _stretched(pitch_error: float) -> Curve:
    return lambda position_m: pitch_error * position_m


EFFECT = Effect(
    name="lead_error",
    description="The screw's lead is off: the table wobbles once per turn or drifts with travel.",
    source="ISO 3408-3 travel deviation: x = R theta + A sin(n theta + phi) + eps x",
    parameters=(
        Parameter("amplitude_m", "m", "Wobble per turn.", -2e-4, 2e-4, 0.0, 4e-6),
        phase(),
        order(1.0),
        Parameter("pitch_error", "m/m", "Travel too long, per travel.", -2e-3, 2e-3, 0.0, 3e-5),
    ),
    contributions=_contributions,
)
