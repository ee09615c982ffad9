"""A screw whose lead is not what it should be."""

import math
from collections.abc import Iterator

import numpy as np

from ..baseline import Baseline
from ..contribution import Contribution, Harmonic, Over, Place, Shift
from ..effect import Effect, Kind, Values, amount, harmonic, order, phase, shape
from ..empirical import Covered, EmpiricalForm, MotionCurve

_PROFILE_ORDERS = (2, 3, 4, 5, 6)


def _contributions(values: Values) -> tuple[Contribution, ...]:
    parts = []
    if values["amplitude_m"]:
        parts.append(Shift(Place.NUT, Over.ANGLE, harmonic(values, "amplitude_m")))
    pitch_error = values["pitch_error"]
    if pitch_error:
        parts.append(Shift(Place.NUT, Over.POSITION, lambda position_m: pitch_error * position_m))
    if values["variation_m"]:
        amplitude, turns_per_m = values["variation_m"], 2.0 * math.pi / values["wavelength_m"]
        slow = Harmonic(amplitude, turns_per_m, values["variation_phase_rad"])
        parts.append(Shift(Place.NUT, Over.POSITION, slow))
    return tuple(parts)


def _empirical_forms(covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    profile = tuple(_travel_wave(covered.low_m, covered.span_m, order) for order in _PROFILE_ORDERS)
    yield EmpiricalForm("profile", transmission=profile)


def _travel_wave(low_m: float, span_m: float, order: int) -> MotionCurve:
    return lambda motion, _: np.cos(order * np.pi * (motion.position_m - low_m) / span_m)


EFFECT = Effect(
    name="lead_error",
    description="The screw's lead is off: the table wobbles once per turn or drifts with travel.",
    source="ISO 3408-3 travel deviation: x = R theta + A sin(n theta + phi) + eps x, and its "
    "variation B sin(2 pi x / L + psi)",
    kind=Kind.TRAVEL,
    parameters=(
        amount("amplitude_m", "m", "Wobble per turn.", -2e-4, 2e-4, 4e-6),
        phase(amount="amplitude_m"),
        order(1.0, amount="amplitude_m", most=6),
        amount("pitch_error", "m/m", "Excess travel per unit of travel.", -2e-3, 2e-3, 3e-5),
        amount("variation_m", "m", "Variation over many turns.", -5e-4, 5e-4, 0.0),
        phase("variation_phase_rad", "variation_m", "Where in the wavelength it begins."),
        shape("wavelength_m", "m", "Length of one variation.", 0.02, 10.0, 0.3, ("variation_m",)),
    ),
    contributions=_contributions,
    imitates=frozenset({"thermal_growth"}),  # a screw that grows unevenly has another lead
    most_shapes=6,
    empirical_forms=_empirical_forms,
)
