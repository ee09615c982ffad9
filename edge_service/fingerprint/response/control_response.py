"""Modes and inertia from a frequency response that a control has measured.

The response of a real axis has many modes, two masses have one. The band that is fitted reaches
from a tenth of the mode's antiresonance to a few times its resonance, and not halfway to the next
notch. The mode is the lowest that stands out of the response of a rigid axis at least half as far
as the greatest one: a machine bed sways below, drive and gears ring above.

What other modes leave in that band is no noise: it is alike from one frequency to the next. The
intervals are widened as if there were fewer frequencies, by (1 - r) / (1 + r) for the correlation r
of neighbours (Bayley and Hammersley, 1946).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from ...messages.samples import Floats
from ...recordings.sinumerik.tuning import MeasuredResponse
from ...regression.interval_estimate import IntervalEstimate, around, normal_quantile, undetermined
from ..result import Contents, Curve, Section, examined
from .frequency_response import LEAST_COHERENCE, FrequencyResponse
from .two_mass_fit import TwoMassFit, fit_two_mass, independent_share, modes

LOWEST_HZ = 5.0
LEAST_PROMINENCE = math.log(2.0)
"""Least rise of a peak, or depth of a notch, over its surroundings."""
_OUT_OF_NOISE = 6.0
"""The same, in standard deviations of the response."""
_RIGID_WITHIN = math.log(1.2)
"""Most that the inertia of a rigid axis seems to differ from its lower to its upper frequencies."""
_INERTIA = "response_inertia_kg_m2"
_BELOW, _ABOVE = 0.1, 3.5
"""Ends of the fitted band over antiresonance and resonance."""
_STRONG = 0.5
_RIGID = 0.7
"""An axis is nearly rigid up to this share of its antiresonance."""
_LEAST_FREQUENCIES = 5
_AWAY = math.log(1.2)
"""Greatest distance of the fitted notch from that of the response."""
_LEAST_SLOPE, _MOST_SLOPE, _LEAST_LATE_DEG = -2.0, -0.5, 45.0
"""Of a mass, which falls as 1 / f below its modes, and is 90 degrees late, less by friction."""

_MECHANICS = {
    *(_INERTIA, "motor_inertia_kg_m2", "load_inertia_kg_m2"),
    *("stiffness_nm_per_rad", "damping_nm_s_per_rad"),
}
_ALIKE = math.log(2.0)
"""Most that inertias found and stated differ, if they are of the same parts and units."""


@dataclass(frozen=True, slots=True)
class Mode:
    """A notch with the peak behind it, as they stand in the response."""

    # antiresonance_hz, resonance_hz: of notch and peak
    antiresonance_hz: float
    resonance_hz: float
    height: float  # peak over notch against a rigid axis, 1


def servo_tuning(measured: MeasuredResponse) -> tuple[Section, list[Mode]]:
    """Section of a response that a control measured, and its modes.

    What the control states stands as a note beside what was found. Inertias far from each other
    are in other units, or of other parts: then none is told.
    """
    whole = FrequencyResponse(  # continuous, and without a window, as nobody knows of one
        frequency_hz=measured.frequency_hz,
        response=measured.response,
        relative_error=relative_error(measured.coherence, measured.averages),
        coherence=measured.coherence,
    )
    known = bool(measured.unit)
    section = examined("multisine", lambda: measure_control_response(whole, known))
    stated, figures = measured.stated, dict(section.figures)
    total = stated.get("total_inertia_kg_m2")
    found = figures[_INERTIA].value if _INERTIA in figures else math.nan
    alike = math.isfinite(found) and found > 0.0
    if total and _INERTIA in figures and not (alike and abs(math.log(found / total)) < _ALIKE):
        note = f"{found:.3g} kg m2, where the control states {total:.3g}: in doubt"
        for name in _MECHANICS & figures.keys():
            figures[name] = undetermined(figures[name].unit, note)
    else:
        for name, key in ((_INERTIA, "total_inertia_kg_m2"), ("motor_inertia_kg_m2",) * 2):
            if key in stated and name in figures:
                note = f"the control states {stated[key]:.4g} kg m2"
                figures[name] = replace(figures[name], note=note)
    return replace(section, figures=figures), modes_of(whole.within(LOWEST_HZ, math.inf))


def measure_control_response(measured: FrequencyResponse, speed_over_torque: bool) -> Contents:
    """Modes of two masses; inertias, stiffness and damping where the units are known.

    Args:
        measured: motor speed over torque.
        speed_over_torque: whether it is in rad/(s N m); if not, only its modes are known.

    Raises ValueError: it is no response of a mass, or has too few frequencies.
    """
    coherent = measured.within(LOWEST_HZ, math.inf).coherent(LEAST_COHERENCE)
    found = modes_of(coherent)
    mode = None  # the lowest of those that stand out
    if found:
        strongest = max(math.log(each.height) for each in found)
        mode = next(each for each in found if math.log(each.height) >= _STRONG * strongest)
    _check_mass(coherent, math.inf if mode is None else _RIGID * mode.antiresonance_hz)
    unit = "rad/(s N m)" if speed_over_torque else "unit unknown"
    labels = ("frequency, Hz", f"speed over torque, {unit}")
    curve = Curve("measured", measured.frequency_hz, np.abs(measured.response), *labels)
    if mode is None:
        note = "no notch with a peak behind it stands out of the response"
        hidden = {name: undetermined("Hz", note) for name in ("antiresonance_hz", "resonance_hz")}
        return (_rigid(coherent) if speed_over_torque else {}) | hidden, (curve,)
    next_hz = min(
        (each.antiresonance_hz for each in found if each.antiresonance_hz > mode.resonance_hz),
        default=math.inf,
    )
    high_hz = min(_ABOVE * mode.resonance_hz, math.sqrt(mode.resonance_hz * next_hz))
    band = coherent.within(_BELOW * mode.antiresonance_hz, high_hz)
    fit = fit_two_mass(band, correlated=True)
    figures = modes(fit)
    if abs(math.log(figures["antiresonance_hz"].value / mode.antiresonance_hz)) >= _AWAY:
        note = f"two masses do not fit the notch at {mode.antiresonance_hz:.4g} Hz"
        figures = {name: undetermined(each.unit, note) for name, each in figures.items()}
    if speed_over_torque:
        figures |= _mechanics(fit, figures["table_share"])
    figures["torque_delay_s"] = fit.delay
    fitted = np.abs(fit.response(band.frequency_hz))
    return figures, (curve, Curve("fit", band.frequency_hz, fitted, *labels))


def modes_of(measured: FrequencyResponse) -> list[Mode]:
    """Every notch that a peak follows, from the lowest on."""
    coherent = measured.coherent(LEAST_COHERENCE)
    frequency = coherent.frequency_hz
    if not len(frequency):
        return []
    level = np.log(np.abs(coherent.response) * frequency)
    noise = float(np.median(coherent.relative_error))
    prominence = max(LEAST_PROMINENCE, _OUT_OF_NOISE * noise)
    notches, _ = signal.find_peaks(-level, prominence=prominence)
    peaks, _ = signal.find_peaks(level, prominence=prominence)
    found = []
    ends = np.append(notches[1:], len(level))
    for notch, following in zip(notches, ends[: len(notches)], strict=True):
        between = peaks[(peaks > notch) & (peaks < following)]
        if len(between):
            peak = between[np.argmax(level[between])]
            height = math.exp(level[peak] - level[notch])
            found.append(Mode(float(frequency[notch]), float(frequency[peak]), height))
    return found


def _check_mass(measured: FrequencyResponse, below_hz: float) -> None:
    """Refuse what does not fall below a frequency as the response of a mass does."""
    rigid = measured.within(LOWEST_HZ, below_hz)
    if len(rigid.frequency_hz) < _LEAST_FREQUENCIES:
        raise ValueError(
            f"{len(rigid.frequency_hz)} coherent frequencies from {LOWEST_HZ:g} Hz up to the first "
            f"mode; expected {_LEAST_FREQUENCIES} or more"
        )
    slope = np.polyfit(np.log(rigid.frequency_hz), np.log(np.abs(rigid.response)), 1)[0]
    late_deg = -float(np.median(np.angle(rigid.response[:_LEAST_FREQUENCIES], deg=True)))
    if not _LEAST_SLOPE < slope < _MOST_SLOPE or late_deg < _LEAST_LATE_DEG:
        raise ValueError(
            f"no response of speed to torque: it goes with the power {slope:.2g} of the frequency, "
            f"{late_deg:.0f} degrees late; a mass has -1 and 90, unless its speed loop is closed"
        )


def _rigid(measured: FrequencyResponse) -> dict[str, IntervalEstimate]:
    """Inertia of an axis that shows no mode, 1 / (2 pi f |G|), averaged by its logarithm."""
    levels = -np.log(2.0 * math.pi * measured.frequency_hz * np.abs(measured.response))
    lower, upper = np.array_split(levels, 2)
    if abs(float(np.median(lower) - np.median(upper))) > _RIGID_WITHIN:
        raise ValueError("the axis is not rigid, and no mode stands out of the noise")
    weights = 1.0 / (measured.relative_error**2 + np.var(levels))
    level = float(np.average(levels, weights=weights))
    share = independent_share(levels - level, measured.relative_error)
    independent = share * len(levels)
    own = float(np.sqrt(1.0 / (share * np.sum(weights))))
    sigma = math.hypot(own, _RIGID_WITHIN / normal_quantile())  # a mode may be hidden in the noise
    found = around(level, sigma, "1", independent)
    value, low, high = (math.exp(each) for each in (found.value, found.low, found.high))
    return {_INERTIA: IntervalEstimate(value, low, high, "kg m^2", independent, found.note)}


def _mechanics(fit: TwoMassFit, share: IntervalEstimate) -> dict[str, IntervalEstimate]:
    """Inertias at the motor, and the spring between them: k = J2 w_a^2, d = 2 z_a k / w_a."""
    found = {_INERTIA: fit.inertia}
    if not math.isfinite(share.value):
        units = {"stiffness_nm_per_rad": "N m/rad", "damping_nm_s_per_rad": "N m s/rad"}
        return found | {name: undetermined(unit, share.note) for name, unit in units.items()}
    value, low, high = 1.0 - share.value, 1.0 - share.high, 1.0 - share.low
    motor_share = replace(share, value=value, low=low, high=high)
    load = _times(fit.inertia, share, "kg m^2")
    speed = fit.antiresonance.scaled(2.0 * math.pi, "rad/s")
    stiffness = _times(_times(load, speed, ""), speed, "N m/rad")
    seconds = (2.0 / speed.value, 2.0 / speed.high, 2.0 / speed.low)
    slowness = IntervalEstimate(*seconds, "s", speed.n_effective)
    damping = _times(_times(stiffness, fit.antiresonance_damping, ""), slowness, "N m s/rad")
    return found | {
        "motor_inertia_kg_m2": _times(fit.inertia, motor_share, "kg m^2"),
        "load_inertia_kg_m2": load,
        "stiffness_nm_per_rad": stiffness,
        "damping_nm_s_per_rad": damping,
    }


def _times(first: IntervalEstimate, second: IntervalEstimate, unit: str) -> IntervalEstimate:
    """Product of two positive quantities, with independent relative errors."""
    value = first.value * second.value
    low, high = (
        math.hypot(math.log(a / first.value), math.log(b / second.value))
        if 0.0 < a < math.inf and 0.0 < b < math.inf
        else math.inf
        for a, b in ((first.low, second.low), (first.high, second.high))
    )
    fewest = min(first.n_effective, second.n_effective)
    return IntervalEstimate(value, value * math.exp(-low), value * math.exp(high), unit, fewest)


def relative_error(coherence: Floats, averages: float) -> Floats:
    """Standard deviation of a response over its magnitude, (n,).

    sqrt((1 - g^2) / (2 g^2 n)) for the coherence g^2 and n averages (Bendat and Piersol, Random
    Data, 2010, table 9.6).
    """
    known = np.clip(coherence, 1e-6, 1.0 - 1e-9)
    error: Floats = np.sqrt((1.0 - known) / (2.0 * known * max(averages, 1.0)))
    return error
