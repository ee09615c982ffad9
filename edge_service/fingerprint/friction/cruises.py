"""Cruises at constant speed: mean torque (the thesis' friction test), its evenness, its orders."""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, signal

from ...messages.samples import ANGLE, TORQUE, Floats
from ...models.screw.ball_screw import BallPassOrders
from ...recordings.conditioning import central_difference, low_pass
from ...regression.interval_estimate import IntervalEstimate, undetermined
from ...regression.linear import correlation_time, effective_size
from ...regression.prepared_run import PreparedRun
from ..result import Contents, Curve, mean_of, rounded_rpm

TREND_HZ = 10.0
"""Slower than the ripple of a revolution at feed speeds, faster than a ramp."""
STEADY, OVER_S = 0.02, 0.1
"""Greatest relative change of a constant speed, and the time within which."""
SETTLE_S = 0.1
"""Cut from the start and the end of each cruise, where the drive settles."""
LEAST_S = 0.1
"""Shortest cruise that is used, after the cut."""
SEGMENT_REVOLUTIONS = 8
SAMPLES_PER_REVOLUTION = 128
LOWEST_ORDER, HIGHEST_ORDER = 0.25, 32.0
BALL_SLIP = 0.03
"""Balls pass within this share of their order: they slip, and the contact angle varies."""
BALLS_UNKNOWN = "needs axis.ball_diameter_m and axis.ball_circle_m in the machine file"
_UNCHANGED_SHARE = 0.6
"""Below this share of its cutoff a 4th-order Butterworth run both ways keeps 98 % and more."""
_WINDOW_BINS = 1.5
"""Bins of noise that a Hann window lets into one."""


@dataclass(frozen=True, slots=True)
class FrictionPoint:
    """Torque at one constant speed."""

    time_s: float  # middle of the cruise, s
    speed_rad_s: float  # mean motor speed, signed, rad/s
    torque_nm: float  # mean torque, signed, N m; what its mean acceleration needs is taken off
    standard_error_nm: float  # of that mean, from the effective number of samples, N m

    @property
    def forward(self) -> bool:
        """Motion in the positive direction."""
        return self.speed_rad_s > 0.0


def friction_points(
    runs: Iterable[PreparedRun], inertia_kg_m2: float = 0.0
) -> Iterator[FrictionPoint]:
    """One point per cruise; the axis' inertia takes off the small acceleration that is left."""
    for run in runs:
        for cruise in cruises(run):
            torque = run.channels[TORQUE][cruise] - inertia_kg_m2 * run.acceleration_rad_s2[cruise]
            independent = len(torque) / correlation_time(torque)
            error_nm = float(np.std(torque)) / math.sqrt(max(independent - 1.0, 1.0))
            time_s = float(np.mean(run.time_s[cruise]))
            speed_rad_s = float(np.mean(run.speed_rad_s[cruise]))
            yield FrictionPoint(time_s, speed_rad_s, float(np.mean(torque)), error_nm)


def cruises(run: PreparedRun) -> Iterator[slice]:
    """Samples of constant speed, trimmed; of a revolution or more, to whole revolutions.

    So what repeats with the screw leaves the mean alone.
    """
    trend_hz = min(TREND_HZ, run.settings.cutoff_hz)
    speed = low_pass(run.speed_rad_s, trend_hz, 2, run.period_s)
    change = np.abs(central_difference(speed, run.period_s)) * OVER_S
    steady = run.moving & (change < STEADY * np.abs(speed))
    margin = math.ceil(SETTLE_S / run.period_s)
    least = max(math.ceil(LEAST_S / run.period_s), 8)
    labels, count = ndimage.label(steady)
    for (where,) in ndimage.find_objects(labels, count):
        start, end = where.start + margin, where.stop - margin
        if end - start < least:
            continue
        angle = run.channels[ANGLE]
        travel = np.abs(angle[start:end] - angle[start])
        revolutions = math.floor(travel[-1] / (2.0 * math.pi))
        if revolutions:
            end = start + int(np.searchsorted(travel, 2.0 * math.pi * revolutions))
        if end - start >= least:
            yield slice(start, end)


def measure_equability(runs: Iterable[PreparedRun]) -> Contents:
    """Root mean square of the torque about its mean at each speed. Raises ValueError: no cruise."""
    ripples: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for cruise in _torque_cruises(runs, revolutions=1.0):
        ripple = signal.detrend(cruise.torque_nm)
        rms = float(np.std(ripple))
        error = 0.5 * rms * math.sqrt(2.0 / effective_size(ripple**2))
        ripples[rounded_rpm(cruise.speed_rad_s)].append((rms, error))
    if not ripples:
        raise ValueError("no cruise of a revolution or more at constant speed")
    figures = {}
    for rpm in sorted(ripples, key=float):
        rms_nm, errors_nm = zip(*ripples[rpm], strict=True)
        figures[f"ripple_{rpm}_rpm_nm"] = mean_of(rms_nm, errors_nm, "N m")
    speeds_rpm = np.array(sorted(map(float, ripples)))
    levels_nm = np.array([figure.value for figure in figures.values()])
    labels = ("screw speed, r/min", "torque ripple, N m rms")
    return figures, (Curve("ripple", speeds_rpm, levels_nm, *labels),)


def measure_signature(runs: Iterable[PreparedRun], balls: BallPassOrders | None = None) -> Contents:
    """Amplitudes of the torque over orders of the screw, at the slowest speed that allows it.

    Welch's average over segments of whole revolutions, sampled evenly over the angle. Balls pass
    at orders that need their number and diameter; without them their band is given as a whole.
    Orders that the low-pass of the preparation weakens at this speed are left out.

    Raises ValueError: no cruise is long enough.
    """
    spectra: dict[str, list[Floats]] = defaultdict(list)
    highest: dict[str, float] = defaultdict(lambda: HIGHEST_ORDER)
    for cruise in _torque_cruises(runs, revolutions=SEGMENT_REVOLUTIONS):
        segments = cruise.power_over_orders()
        if not segments:  # a few samples short of one
            continue
        rpm = rounded_rpm(cruise.speed_rad_s)
        spectra[rpm] += segments
        highest[rpm] = min(highest[rpm], cruise.highest_order)
    if not spectra:
        raise ValueError(f"no cruise of {SEGMENT_REVOLUTIONS} revolutions at constant speed")
    rpm = min(spectra, key=float)
    power = np.array(spectra[rpm])
    order = np.arange(power.shape[1]) / SEGMENT_REVOLUTIONS
    bands = {
        "below_once_per_rev": (LOWEST_ORDER, 0.75),
        "once_per_rev": (0.75, 1.25),
        "twice_per_rev": (1.75, 2.25),
        "orders_3_to_8": (2.5, 8.0),
        "balls_8_to_32": (8.0, HIGHEST_ORDER),
    }
    figures = {
        f"{name}_{rpm}_rpm_nm": _band_rms(power[:, (order >= low) & (order <= high)])
        for name, (low, high) in bands.items()
        if high <= highest[rpm]
    }
    figures |= _ball_figures(balls, power, order, rpm, highest[rpm])
    if not any(figure.determined for figure in figures.values()):
        raise ValueError(f"at {rpm} r/min, the slowest, every order lies above the low-pass")
    shown = (order >= LOWEST_ORDER) & (order <= highest[rpm])
    amplitude = np.sqrt(2.0 * np.mean(power, axis=0))
    labels = ("order, per revolution of the screw", "torque amplitude, N m")
    return figures, (Curve(f"{rpm} r/min", order[shown], amplitude[shown], *labels),)


def _ball_figures(
    balls: BallPassOrders | None, power: Floats, order: Floats, rpm: str, highest: float
) -> dict[str, IntervalEstimate]:
    """Root mean squares about the orders of the balls, each with its order as a note."""
    if balls is None:
        return {"ball_pass_nm": undetermined("N m", BALLS_UNKNOWN)}
    orders = {
        "ball_pass_on_nut": balls.on_nut,
        "ball_pass_on_screw": balls.on_screw,
        "ball_spin": balls.spin,
    }
    figures = {}
    for name, centre in orders.items():
        half = max(BALL_SLIP * centre, 1.0 / SEGMENT_REVOLUTIONS)
        key, note = f"{name}_{rpm}_rpm_nm", f"{name.replace('_', ' ')} {centre:.1f}/rev"
        if centre + half > highest:
            figures[key] = undetermined("N m", f"{note} lies above the low-pass at {rpm} r/min")
        else:
            about = np.abs(order - centre) <= half
            figures[key] = replace(_band_rms(power[:, about]), note=note)
    return figures


@dataclass(frozen=True, slots=True, eq=False)
class _TorqueCruise:
    """Torque over the angle at one constant speed, (n,) each."""

    angle_rad: Floats
    torque_nm: Floats
    speed_rad_s: float
    cutoff_hz: float

    @property
    def highest_order(self) -> float:
        """Order up to which the low-pass lets torque through unchanged."""
        return _UNCHANGED_SHARE * self.cutoff_hz * 2.0 * math.pi / abs(self.speed_rad_s)

    def power_over_orders(self) -> list[Floats]:
        """Mean squares in bins of 1 / SEGMENT_REVOLUTIONS of an order, one (m,) per segment."""
        turned = np.abs(self.angle_rad - self.angle_rad[0]) / (2.0 * math.pi)
        size = SEGMENT_REVOLUTIONS * SAMPLES_PER_REVOLUTION
        grid = np.arange(0.0, turned[-1], 1.0 / SAMPLES_PER_REVOLUTION)
        torque = np.interp(grid, turned, self.torque_nm)
        window = signal.windows.hann(size, sym=False)
        powers = []
        for start in range(0, len(grid) - size + 1, size // 2):
            piece = signal.detrend(torque[start : start + size]) * window
            powers.append(2.0 * np.abs(np.fft.rfft(piece) / window.sum()) ** 2)
        return powers


def _torque_cruises(runs: Iterable[PreparedRun], revolutions: float) -> Iterator[_TorqueCruise]:
    for run in runs:
        for inside in cruises(run):
            angle = run.channels[ANGLE][inside]
            if abs(angle[-1] - angle[0]) > 2.0 * math.pi * (revolutions - 0.05):
                speed = float(np.mean(run.speed_rad_s[inside]))
                torque = run.channels[TORQUE][inside]
                yield _TorqueCruise(angle, torque, speed, run.settings.cutoff_hz)


def _band_rms(power: Floats) -> IntervalEstimate:
    """Root mean square within bins, (segments, bins); overlapping segments count as half."""
    squares = np.sum(power, axis=1) / _WINDOW_BINS
    mean = float(np.mean(squares))
    error = float(np.std(squares)) / math.sqrt(max(0.5 * len(squares), 1.0))
    if len(squares) < 3:
        error = mean  # one or two segments say nothing of their scatter
    rms = math.sqrt(mean)
    return mean_of([rms], [0.5 * error / max(rms, 1e-12)], "N m")
