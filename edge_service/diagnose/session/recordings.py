"""Recordings as runs of native-rate motion on one clock."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy import ndimage

from ...checks.same_axis import by_recording
from ...messages.samples import (
    ANGLE,
    EXTERNAL_FORCE,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    Booleans,
    Floats,
    SampleFrame,
)
from ...models.effects.baseline import Baseline, Motion
from ...recordings.conditioning import (
    UniformRun,
    central_difference,
    low_pass,
    uniform_runs,
    white_noise_rms,
    with_angle,
)
from ...regression.run import FILTER_ORDER, Filter, Run, misses_acceleration

MOTION_CUTOFF_HZ = 100.0
"""Low-pass of the measured angle before it is differentiated."""
STILL_RAD_S = 0.1
"""Up to this motor speed the axis is at rest, unless the encoder's noise asks for more."""
_CERTAIN_SIGMAS = 6.0
"""Standard deviations of noise from which on a value is surely none."""
_SLOWEST_SHARE = 0.1
"""Of the greatest speed: up to it samples with much noise count as rest, no further."""
_LASTING_SHARE = 0.02
"""Of the strongest acceleration: by so much it may change from sample to sample and still last."""
_SMOOTH_SHARE, _SMOOTH_QUANTILE = 0.1, 0.1257
"""A tenth, and what lies within that quantile of the size of a standard normal variable."""
_OLD_SHARE = 0.2  # of values kept while a table is fast: they show no acceleration
_AT_LIMIT = 0.999
"""Of the drive's limit: as exactly as drives state their torque."""
TEMPERATURE_MEAN_S = 5.0
"""A housing warms up slowly: its sensor's noise and steps are no warmth."""
STRETCH = "stretch_m"
STEPS, _NO_STEP = "torque_steps", 1e-6  # of the greatest torque
EDGE_S = 0.1
LEAST_RUN_S = 1.0
_OPTIONAL = (SETPOINT, TEMPERATURE, EXTERNAL_FORCE)


def runs_of(
    recordings: Iterable[Iterable[SampleFrame] | SampleFrame],
    baseline: Baseline,
    least_s: float = LEAST_RUN_S,
) -> list[Run]:
    """Unbroken runs of recordings of one axis, filtered, in bounded memory; none below `least_s`.

    Raises ValueError: no position, or no clock.
    """
    return on_one_clock(unbroken_runs(recordings, baseline, least_s))


def unbroken_runs(
    recordings: Iterable[Iterable[SampleFrame] | SampleFrame],
    baseline: Baseline,
    least_s: float = LEAST_RUN_S,
) -> Iterator[Run]:
    """Runs, one after another, each recording on its own clock.

    Raises ValueError: no position, or no clock.
    """
    for number, recording in enumerate(recordings):
        frames = iter([recording] if isinstance(recording, SampleFrame) else recording)
        first = next(frames, None)
        if first is None:
            continue
        needed = tuple(name for name in (ANGLE, TORQUE, TABLE_POSITION) if name in first.channels)
        if ANGLE not in needed:
            needed = (ANGLE, *(name for name in needed if name != TABLE_POSITION))
        angled = with_angle(itertools.chain([first], frames), baseline.ratio_m_per_rad)
        for uniform in uniform_runs(angled, needed, optional=_OPTIONAL):
            if len(uniform) * uniform.period_s >= least_s:
                yield _run_of(uniform, baseline, number)


def _run_of(run: UniformRun, baseline: Baseline, number: int) -> Run:
    slow, raw = misses_acceleration(run.period_s), run.channels
    cutoff_hz = min(MOTION_CUTOFF_HZ, 0.4 / run.period_s)
    names = [n for n in (ANGLE, TORQUE, TABLE_POSITION, EXTERNAL_FORCE) if n in raw]
    passed = cutoff_hz, FILTER_ORDER, run.period_s
    smooth = {name: raw[name] if slow else low_pass(raw[name], *passed) for name in names}
    speed = central_difference(smooth[ANGLE], run.period_s)
    noise = {name: (_slow_noise_rms if slow else white_noise_rms)(raw[name]) for name in names}
    if slow:
        acceleration, resolved = _second_difference(smooth[ANGLE], run.period_s, noise[ANGLE])
        wavers = _CERTAIN_SIGMAS * noise[ANGLE] / math.sqrt(2.0) / run.period_s
    else:
        acceleration = central_difference(speed, run.period_s)
        resolved = np.ones(len(run), dtype=np.bool_)
        wavers = _CERTAIN_SIGMAS * noise[ANGLE] * cutoff_hz**1.5 * run.period_s**0.5 * 4.0
    still = max(STILL_RAD_S, min(wavers, _SLOWEST_SHARE * float(np.abs(speed).max())))
    edge = math.ceil(EDGE_S / run.period_s)
    inside = slice(edge, len(run) - edge)
    moving = _moving(speed[inside], still, run.period_s)
    if TORQUE in raw:
        noise[STEPS] = _steps_rms(raw[TORQUE][inside][moving])
    given = {name: values[inside] for name, values in {**raw, **smooth}.items()}
    if TEMPERATURE in raw:
        reach = max(round(TEMPERATURE_MEAN_S / run.period_s), 1)
        given[TEMPERATURE] = ndimage.uniform_filter1d(given[TEMPERATURE], reach, mode="nearest")
    stretch = carried = None
    if TABLE_POSITION in raw:
        pace = central_difference(smooth[TABLE_POSITION], run.period_s) / baseline.ratio_m_per_rad
        fast = np.abs(speed[1:]) > 0.5 * np.abs(speed).max()
        is_old = np.mean(np.diff(raw[TABLE_POSITION])[fast] == 0.0) > _OLD_SHARE
        carried = None if slow or is_old else central_difference(pace, run.period_s)[inside]
        stretch = (raw[TABLE_POSITION] - baseline.ratio_m_per_rad * raw[ANGLE])[inside]
        table, motor = (max(noise[n], _steps_rms(raw[n])) for n in (TABLE_POSITION, ANGLE))
        noise[STRETCH] = math.hypot(table, baseline.ratio_m_per_rad * motor)
    motion = Motion.of_samples(
        baseline,
        run.time_s[inside],
        given[ANGLE],
        speed[inside],
        acceleration[inside],
        position_m=given.get(TABLE_POSITION),
        torque_nm=given.get(TORQUE),
        external_force_n=given.get(EXTERNAL_FORCE),
        temperature_c=given.get(TEMPERATURE),
        table_rad_s2=carried,
    )
    motion = replace(motion, direction=np.where(moving, motion.direction, 0.0))
    resolved = resolved[inside]
    if slow:  # samples that move as those before and after them do
        same = motion.direction[1:] == motion.direction[:-1]
        resolved = resolved & np.append(same, True) & np.insert(same, 0, True)
    low_pass_of = Filter.of_period(run.period_s)
    clipped = np.zeros(len(motion), dtype=np.bool_)
    if TORQUE in raw:
        limit_nm = baseline.torque_limit_nm
        clipped = np.abs(raw[TORQUE][inside]) >= _AT_LIMIT * limit_nm
        clipped &= np.abs(motion.model_torque_nm) > limit_nm
        clipped = ndimage.binary_dilation(clipped, np.ones(len(low_pass_of.taps), np.bool_))
    return Run(
        motion=motion,
        moving=moving,
        resolved=resolved,
        clipped=clipped,
        transmission_m=stretch,
        temperature_c=given.get(TEMPERATURE),
        setpoint_m=given.get(SETPOINT),
        recording=number,
        low_pass=low_pass_of,
        noise=noise,
    )


def _steps_rms(values: Floats) -> float:
    """Error of rounding of a series (n,) that mostly keeps the value before; otherwise 0."""
    change = np.abs(np.diff(values))
    steps = change[change > _NO_STEP * np.abs(values).max(initial=0.0)]
    is_coarse = 0 < len(steps) < 0.5 * len(change)
    return float(steps.min()) / math.sqrt(12.0) if is_coarse else 0.0


def _slow_noise_rms(values: Floats) -> float:
    """White noise on a series (n,) that is smooth in a tenth of its length at least."""
    fifth = np.abs(np.diff(values, 5))
    size = np.quantile(fifth, _SMOOTH_SHARE) if fifth.size else 0.0
    return float(size / _SMOOTH_QUANTILE / math.sqrt(252.0))


def _second_difference(
    angle_rad: Floats, period_s: float, noise_rad: float
) -> tuple[Floats, Booleans]:
    """Acceleration (n,), 0 where it may be noise, and which samples see it last (n,)."""
    bend = np.pad(np.diff(angle_rad, 2), 1) / period_s**2
    noise, change = noise_rad / period_s**2, np.abs(np.diff(bend))
    change = np.maximum(np.append(change, 0.0), np.insert(change, 0, 0.0))
    strong = float(np.quantile(np.abs(bend), 0.99))
    lasting = change <= max(_LASTING_SHARE * strong, _CERTAIN_SIGMAS * math.sqrt(20.0) * noise)
    certain = np.abs(bend) > 0.5 * _CERTAIN_SIGMAS * math.sqrt(6.0) * noise
    return np.where(certain, bend, 0.0), lasting


def _moving(speed_rad_s: Floats, still_rad_s: float, period_s: float) -> Booleans:
    """Not at rest; a passage through zero shorter than 20 ms is no rest."""
    fast: Booleans = np.abs(speed_rad_s) > still_rad_s
    reach = round(0.02 / period_s)
    if reach < 1:
        return fast
    padded = np.pad(fast, reach, mode="edge")
    closed: Booleans = ndimage.binary_closing(padded, np.ones(reach + 1, dtype=bool))
    return closed[reach:-reach] | fast


LONGEST_S = 600.0
"""Of a longer session every second minute is kept, or every fourth, and so on."""
PIECE_S = 60.0
_DIGITS, _COPIED, _SEAM_S = 6, 0.1, 10.0
"""Decimals of rad, N m, mm; of its rows in motion, a copy has more in another recording; and one
that ends so long before the next, on one clock, goes on in it."""
PAUSE_S = 1.0
"""Between recordings whose own clocks do not tell how far apart they were made."""


def on_one_clock(runs: Iterable[Run]) -> list[Run]:
    """Runs in the order of one clock, whatever the order of the recordings.

    Recordings whose clocks overlap (each may begin at 0) follow one another, the coldest first:
    an axis warms up in a session. A copy of another is left out; a part joins the one before it.
    """
    recordings = _counted_once(thinned(runs))
    spans = itertools.pairwise(map(_span_s, recordings))
    if all(before[1] < after[0] for before, after in spans):
        return [run for each in recordings for run in each]
    placed: list[Run] = []
    for each in sorted(recordings, key=_coldness):
        shift_s = _span_s(placed[-1:])[1] + PAUSE_S - _span_s(each)[0] if placed else 0.0
        for run in each:
            motion = replace(run.motion, time_s=run.motion.time_s + shift_s)
            placed.append(replace(run, motion=motion))
    return placed


def _counted_once(runs: Iterable[Run]) -> list[list[Run]]:
    found, known = list[list[Run]](), np.empty(0, np.complex128)
    for each in sorted(by_recording(runs).values(), key=_span_s):
        rows = np.round(np.concatenate([_moved(run) for run in each]), _DIGITS)
        if np.isin(rows, known).sum() > _COPIED * len(rows):
            continue
        known, before = np.append(known, rows), found[-1] if found else each
        if 0.0 < _span_s(each)[0] - _span_s(before)[1] < _SEAM_S:
            before += [replace(run, recording=before[0].recording) for run in each]
        else:
            found.append(each)
    return found


def _moved(run: Run) -> Any:
    """Angle, and torque with stretch, of the samples in motion as complex numbers, (k,)."""
    apart_m = 0.0 if run.transmission_m is None else run.transmission_m
    torque_nm = np.nan_to_num(run.motion.torque_nm)
    return (run.motion.angle_rad + 1j * (torque_nm + 1e3 * apart_m))[run.moving]


def thinned(runs: Iterable[Run]) -> list[Run]:
    """Runs of at most about `LONGEST_S` in all, evenly spread over what was recorded."""
    kept: list[tuple[int, Run]] = []
    stride, number = 1, 0
    for run in runs:
        for part in [run] if stride == 1 else _pieces(run):
            if number % stride == 0:
                kept.append((number, part))
            number += 1
        while sum(each.duration_s for _, each in kept) > LONGEST_S:
            if stride == 1:
                cut = [piece for _, each in kept for piece in _pieces(each)]
                kept, number = list(enumerate(cut)), len(cut)
            stride *= 2
            kept = [(k, each) for k, each in kept if k % stride == 0]
    return [run for _, run in kept]


def _span_s(runs: Sequence[Run]) -> tuple[float, float]:
    times_s = [run.motion.time_s[k] for run in runs for k in (0, -1)]
    return float(min(times_s)), float(max(times_s))


def _coldness(runs: Sequence[Run]) -> tuple[float, ...]:
    """Temperature, then whatever else distinguishes recordings without regard to their order."""
    warmth = [float(run.temperature_c.mean()) for run in runs if run.temperature_c is not None]
    angle_rad = runs[0].motion.angle_rad
    return min(warmth, default=0.0), *_span_s(runs), float(angle_rad[0]), float(angle_rad.mean())


def _pieces(run: Run) -> Iterator[Run]:
    step = max(round(PIECE_S * len(run.motion) / max(run.duration_s, 1e-9)), 1)
    if len(run.motion) <= 1.5 * step:
        yield run
        return
    for start in range(0, len(run.motion) - step // 2, step):
        end = start + step if len(run.motion) - start - step >= step // 2 else len(run.motion)
        yield _cut(run, slice(start, end))


def _cut(run: Run, span: slice) -> Run:
    def parts(of: Run | Motion) -> dict[str, Any]:
        series = {each.name: getattr(of, each.name) for each in fields(of) if each.init}
        return {n: x[span].copy() for n, x in series.items() if isinstance(x, np.ndarray)}

    return replace(run, motion=replace(run.motion, **parts(run.motion)), **parts(run))
