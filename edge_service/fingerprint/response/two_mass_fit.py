"""Two masses with a spring, fitted to a measured response (the thesis' second, 5.3.19-5.3.21)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from ...messages.samples import Floats, SampleFrame
from ...regression.interval_estimate import IntervalEstimate, undetermined
from ...regression.nonlinear import Residual, Unknown, best_values, fit_profiled, unexplained_share
from ..result import Contents, Curve
from .frequency_response import (
    Complexes,
    FrequencyResponse,
    drive_response,
    drive_responses_along,
    sampling_correction,
)

_FIRST_ERROR = 0.01
"""Share of a response that the search for the best fit takes as its error."""
_BEYOND = 10.0
"""A resonance is searched up to this factor above the fastest frequency."""
_STEEPEST = 0.9
"""Greatest change of the compliance over half of the travel, as a share of that in its middle."""
_WINDOW_BINS = 1.5
"""Bins of a Hann window that are one independent one."""
_LEAST_FREQUENCIES = 10
_LEAST_SHARE = 1e-5
_MOST_CORRELATED = 0.95
_FEW = 400
"""Frequencies on which the first valley is looked for."""
SHAKEN_HZ, LEAST_SHAKEN = 50.0, 75
"""No everyday motion moves an axis coherently above so much, at so many frequencies."""
LOWEST_HZ = 5.0
MOST_DAMPING = math.sqrt(0.5)
"""Damping ratio above which a mode has no peak."""


class TwoMasses(NamedTuple):
    """Two masses with the spring that lies where the motor stands at `place_rad`."""

    inertia: float  # J1 + J2 at the motor, kg m^2
    antiresonance: float  # w_a / 2 pi of the table against a motor that is held, Hz
    damping: float  # damping ratio of that, 1
    ratio: float  # w_r / w_a = sqrt((J1 + J2) / J1), 1
    delay: float  # of the torque path, s
    viscous: float  # D between motor and ground, N m s/rad
    slope: float = 0.0  # relative change of the compliance per turn of the motor, 1/rad

    def at(self, turned_rad: Floats) -> tuple[Floats, Floats, Floats]:
        """w_r in rad/s, its damping ratio, and 1 / w_a^2 - 1 / w_r^2 in s^2, in that shape.

        The compliance C is linear along the stroke (5.3.9): w ~ C^-1/2 and, with one damper, the
        damping ratio ~ C^1/2.
        """
        softness = np.maximum(1.0 + self.slope * turned_rad, 1e-3)
        notch = 2.0 * math.pi * self.antiresonance / np.sqrt(softness)
        damping = np.minimum(self.damping * self.ratio * np.sqrt(softness), 1.0 - 1e-6)
        return notch * self.ratio, damping, (1.0 - self.ratio**-2) / notch**2

    def flexible(self, s: Complexes, turned_rad: Floats) -> Complexes:
        """J times what the spring adds to 1 / (J s): s (1/w_a^2 - 1/w_r^2) / D(s); broadcast."""
        peak, damping, share = self.at(turned_rad)
        added: Complexes = share * s / ((s / peak) ** 2 + 2.0 * damping * s / peak + 1.0)
        return added

    def slowed(self, s: Complexes, flexible: Complexes) -> Complexes:
        """Factor that viscous friction applies to `flexible`: it brakes the spring too.

        With d = D / J and N / D(s) = 1 + s flexible, 1 / (J s D(s) / N + D) less 1 / (J s + D) is
        flexible / J over (1 + d/s) (1 + d/s N/D(s)).
        """
        drop = self.viscous / self.inertia / s
        factor: Complexes = 1.0 / ((1.0 + drop) * (1.0 + drop * (1.0 + s * flexible)))
        return factor

    def speed_over_torque(self, frequency_hz: Floats, turned_rad: float = 0.0) -> Complexes:
        """Without sampling, rad/(s N m), (n,): N / (J s D(s) + D N) exp(-s T)."""
        s = (2j * math.pi * frequency_hz).astype(np.complex128)
        flexible = self.flexible(s, np.array(turned_rad))
        rigid = 1.0 / (s + self.viscous / self.inertia)
        whole = rigid + flexible * self.slowed(s, flexible)
        response: Complexes = whole / self.inertia * np.exp(-s * self.delay)
        return response


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """View of a model in responses at n frequencies: sampled, windowed, and averaged over the way.

    A Hann window's power spectrum has a variance of a third of a bin squared, as the weights 1/6,
    2/3, 1/6 of neighbouring bins have; unless it is allowed for, a resonance seems to be damped
    more. So does one that moves with the nut: two places a standard deviation before and behind the
    mean one stand for the way.
    """

    s: Complexes  # at the frequencies, and behind them at those a bin below and above, (k n,), 1/s
    differences: Complexes  # what turns the angle to a held torque into speed, (k n,)
    turned_rad: Floats  # of the places from the middle one, (2, k n)
    period_s: float  # of the samples; 0 where the torque is continuous
    count: int

    @classmethod
    def of(cls, measured: FrequencyResponse, centre_rad: float) -> Self:
        """The sight of a measured response."""
        frequency, step = measured.frequency_hz, measured.resolution_hz
        parts = [frequency]
        if step > 0.0:
            parts += [np.maximum(frequency - step, 0.5 * frequency), frequency + step]
        s = (2j * math.pi * np.concatenate(parts)).astype(np.complex128)
        period_s = measured.period_s
        differences: Complexes = np.ones(len(s), dtype=np.complex128)
        if period_s > 0.0:
            corrected = sampling_correction(np.concatenate(parts), period_s)
            differences = corrected * (1.0 - np.exp(-s * period_s)) / period_s
        turned = np.zeros((2, len(frequency)))
        if len(measured.place_rad):
            turned += measured.place_rad - centre_rad
            turned += measured.spread_rad * np.array([[-1.0], [1.0]])
        return cls(s, differences, np.tile(turned, len(parts)), period_s, len(frequency))

    def response(self, model: TwoMasses) -> Complexes:
        """Response that a measurement without noise would give, rad/(s N m), (n,)."""
        flexible = model.flexible(self.s, self.turned_rad)
        seen = flexible if self.period_s == 0.0 else self._held(model)
        slowed = np.mean(seen * model.slowed(self.s, flexible), axis=0)
        rigid = 1.0 / (self.s + model.viscous / model.inertia)
        whole: Complexes = (rigid + slowed) / model.inertia * np.exp(-self.s * model.delay)
        if len(whole) == self.count:
            return whole
        at, below, above = whole.reshape(3, self.count)
        windowed: Complexes = (below + 4.0 * at + above) / 6.0
        return windowed

    def _held(self, model: TwoMasses) -> Complexes:
        """`flexible` as differences of the angle to a held torque show it, (2, k n)."""
        peak, damping, share = model.at(self.turned_rad)
        z = np.exp(self.s * self.period_s)
        decay = np.exp(-damping * peak * self.period_s)
        root = np.sqrt(1.0 - damping**2)
        turn = peak * root * self.period_s
        cosine, lag = np.cos(turn), damping / root * np.sin(turn)
        b1 = 1.0 - decay * (cosine + lag)
        b2 = decay**2 + decay * (lag - cosine)
        held = share * (b1 * z + b2) / ((z - 2.0 * decay * cosine) * z + decay**2)
        seen: Complexes = self.differences * held
        return seen


@dataclass(frozen=True, slots=True)
class TwoMassFit:
    """Inertias and resonance of the axis, in the middle of the recorded travel."""

    inertia: IntervalEstimate  # J1 + J2 at the motor, kg m^2
    antiresonance: IntervalEstimate  # of the table against a motor that is held, w_a, Hz
    resonance: IntervalEstimate  # of both against each other, w_r, Hz
    # antiresonance_damping, resonance_damping: damping ratios, 1
    antiresonance_damping: IntervalEstimate
    resonance_damping: IntervalEstimate
    table_share: IntervalEstimate  # J2 / (J1 + J2) = 1 - (w_a / w_r)^2, 1
    delay: IntervalEstimate  # of the torque path, s
    viscous: IntervalEstimate  # D of (5.3.19), between motor and ground, N m s/rad
    place_rad: float  # angle of the motor to which the modes belong
    model: TwoMasses

    def response(self, frequency_hz: Floats) -> Complexes:
        """The fitted motor speed over torque, without sampling, rad/(s N m), (n,)."""
        return self.model.speed_over_torque(frequency_hz)


def measure_response(recordings: Sequence[SampleFrame]) -> Contents:
    """Response with the modes of two masses (5.3.19-5.3.21). Raises ValueError: nothing shakes."""
    shaken = [frame for frame in recordings if shakes(frame)]
    if not shaken:
        raise ValueError(f"no recording moves the axis coherently above {SHAKEN_HZ:g} Hz")
    measured = drive_response(shaken).within(LOWEST_HZ, math.inf)
    places = drive_responses_along(shaken)
    fit = fit_two_mass([place.within(LOWEST_HZ, math.inf) for place in places])
    figures = modes(fit) | {"response_inertia_kg_m2": fit.inertia, "torque_delay_s": fit.delay}
    labels = ("frequency, Hz", "speed over torque, rad/(s N m)")
    frequency = measured.frequency_hz
    return figures, (
        Curve("measured", frequency, np.abs(measured.response), *labels),
        Curve("fit", frequency, np.abs(fit.response(frequency)), *labels),
    )


def shakes(frame: SampleFrame) -> bool:
    """Coherent motion at high frequencies, as of a chirp or multisine."""
    try:
        response = drive_response([frame])
    except ValueError:  # a channel is missing, or the run is too short
        return False
    return int(np.sum(response.within(SHAKEN_HZ, math.inf).coherence > 0.9)) >= LEAST_SHAKEN


def fit_two_mass(
    measured: FrequencyResponse | Sequence[FrequencyResponse], *, correlated: bool = False
) -> TwoMassFit:
    """Fit omega / torque = 1 / (J s + D) N(s) / D(s) exp(-s T).

    N = s^2 / w_a^2 + 2 z s / w_a + 1 and D(s) with w_r and z w_r / w_a, for one damper makes both.
    As J1 and J2 are not negative, w_r / w_a = sqrt((J1 + J2) / J1) is at least 1. With responses at
    several places the compliance may change linearly along the travel.

    Args:
        measured: of `drive_response` or `drive_responses_along`, within the frequencies to be
            fitted.
        correlated: neighbours err alike, by what two masses leave.

    Raises ValueError: fewer than ten frequencies.
    """
    places = [measured] if isinstance(measured, FrequencyResponse) else list(measured)
    count = sum(len(place.frequency_hz) for place in places)
    if count < _LEAST_FREQUENCIES:
        raise ValueError(
            f"{count} coherent frequencies; a two-mass fit needs {_LEAST_FREQUENCIES} or more"
        )
    places = [place for place in places if len(place.frequency_hz)]
    known = np.concatenate([place.place_rad for place in places])
    centre_rad = float(np.mean(known)) if len(known) else math.nan
    unknowns = _unknowns(places, centre_rad)
    misfit = _misfit(places, centre_rad)
    error = _error(places)
    # the best valley of all starts, on few frequencies
    few = [place.every(max(count // _FEW, 1)) for place in places]
    misfit_few, error_few = _misfit(few, centre_rad), np.hypot(_error(few), _FIRST_ERROR)
    starts = [start[: len(unknowns)] for start in _starts(places)]
    first = best_values(lambda values: misfit_few(values) / error_few, unknowns, starts)
    rough = np.hypot(error, _FIRST_ERROR)
    first = best_values(lambda values: misfit(values) / rough, unknowns, [first])
    left, counted = misfit(first), 2.0 * count
    if correlated:
        counted *= independent_share(left[:count] + 1j * left[count:], error[:count])
    share = unexplained_share(left, error, np.ones_like(error), len(unknowns))
    error = np.hypot(error, max(share, _LEAST_SHARE))
    counted /= _WINDOW_BINS if any(place.resolution_hz > 0.0 for place in places) else 1.0
    fit = fit_profiled(lambda values: misfit(values) / error, unknowns, [first], counted)
    found = fit.parameters
    notch, damping, ratio = found["antiresonance"], found["damping"], found["ratio"]
    low, value, high = (1.0 - bound**-2 for bound in (ratio.low, ratio.value, ratio.high))
    return TwoMassFit(
        inertia=found["inertia"],
        antiresonance=notch,
        resonance=_product(notch, ratio),
        antiresonance_damping=damping,
        resonance_damping=_product(damping, ratio),
        table_share=IntervalEstimate(value, low, high, "1", ratio.n_effective, ratio.note),
        delay=found["delay"],
        viscous=found["viscous"],
        place_rad=centre_rad,
        model=TwoMasses(*fit.values.tolist()),
    )


def modes(fit: TwoMassFit) -> dict[str, IntervalEstimate]:
    """Figures of the two modes, undetermined where what was fitted does not ring.

    A mode whose damping ratio is above 1/sqrt(2) has no peak (Ewins, Modal Testing): such a fit
    bends to friction or noise on an axis whose true modes lie beyond the recording.
    """
    found = {
        "antiresonance_hz": fit.antiresonance,
        "resonance_hz": fit.resonance,
        "resonance_damping": fit.resonance_damping,
        "table_share": fit.table_share,
    }
    if not fit.resonance_damping.value >= MOST_DAMPING:
        return found
    note = f"no resonance: the fitted mode has a damping ratio of {fit.resonance_damping.value:.2g}"
    return {name: undetermined(each.unit, note) for name, each in found.items()}


def independent_share(misfit: Floats | Complexes, error: Floats) -> float:
    """Share of the frequencies that count, for the correlation of neighbouring misfits."""
    weighted = misfit / np.hypot(error, float(np.std(misfit)))
    deviations = weighted - np.mean(weighted)
    power = float(np.sum(np.abs(deviations) ** 2))
    if not power > 0.0:
        return 1.0
    lagged = float(np.sum((deviations[1:] * np.conj(deviations[:-1])).real))
    correlation = min(max(lagged / power, 0.0), _MOST_CORRELATED)
    return (1.0 - correlation) / (1.0 + correlation)


def _misfit(places: Sequence[FrequencyResponse], centre_rad: float) -> Residual:
    """Logarithm of model over measurement, real and imaginary parts one after the other."""
    sights = [Sight.of(place, centre_rad) for place in places]
    responses = np.concatenate([place.response for place in places])

    def misfit(values: Floats) -> Floats:
        model = TwoMasses(*values.tolist())
        whole = np.log(np.concatenate([sight.response(model) for sight in sights]) / responses)
        return np.concatenate((whole.real, whole.imag))

    return misfit


def _error(places: Sequence[FrequencyResponse]) -> Floats:
    return np.tile(np.concatenate([place.relative_error for place in places]), 2)


def _unknowns(places: Sequence[FrequencyResponse], centre_rad: float) -> list[Unknown]:
    inertia = _low_frequency_inertia(places)
    low_hz = min(float(place.frequency_hz[0]) for place in places)
    high_hz = max(float(place.frequency_hz[-1]) for place in places)
    unknowns = [
        Unknown("inertia", inertia / 20.0, inertia * 20.0, "kg m^2", logarithmic=True),
        Unknown("antiresonance", low_hz, _BEYOND * high_hz, "Hz", logarithmic=True),
        Unknown("damping", 1e-3, 1.0, "1", logarithmic=True),
        Unknown("ratio", 1.0, 10.0, "1", floor=1.0),
        Unknown("delay", -5e-3, 2e-2, "s"),
        Unknown("viscous", 0.0, 2.0 * math.pi * low_hz * inertia, "N m s/rad", floor=0.0),
    ]
    reaches_rad = [np.abs(place.place_rad - centre_rad) + place.spread_rad for place in places]
    reach_rad = max(float(np.max(each, initial=0.0)) for each in reaches_rad)
    if len(places) > 1 and reach_rad > 0.0:
        steepest = _STEEPEST / reach_rad
        unknowns.append(Unknown("slope", -steepest, steepest, "1/rad"))
    return unknowns


def _starts(places: Sequence[FrequencyResponse]) -> list[Floats]:
    """A notch where the response shows one, near the end of the band, and beyond it."""
    inertia = _low_frequency_inertia(places)
    high_hz = max(float(place.frequency_hz[-1]) for place in places)
    frequency = np.concatenate([place.frequency_hz for place in places])
    response = np.concatenate([place.response for place in places])
    deepest_hz = float(frequency[np.argmin(np.abs(response) * frequency)])
    notches_hz = (deepest_hz, 0.5 * high_hz, high_hz, 0.5 * _BEYOND * high_hz)
    return [
        np.array([inertia, notch_hz, 0.05, ratio, 0.0, 0.0, 0.0])
        for notch_hz in notches_hz
        for ratio in (1.05, 1.5)
    ]


def _low_frequency_inertia(places: Sequence[FrequencyResponse]) -> float:
    """Inertia that the lowest quarter of the frequencies shows, kg m^2."""
    frequency = np.concatenate([place.frequency_hz for place in places])
    response = np.concatenate([place.response for place in places])
    order = np.argsort(frequency)[: max(len(frequency) // 4, 1)]
    return float(np.median(1.0 / (2.0 * math.pi * frequency[order] * np.abs(response[order]))))


def _product(first: IntervalEstimate, second: IntervalEstimate) -> IntervalEstimate:
    """Product of two positive quantities in the unit of the first, with the bounds of both."""
    value, low, high = first.value * second.value, first.low * second.low, first.high * second.high
    count, note = min(first.n_effective, second.n_effective), first.note or second.note
    return IntervalEstimate(value, low, high, first.unit, count, note)
