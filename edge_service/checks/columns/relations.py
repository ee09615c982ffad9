"""Relations between the columns of one recording, whatever their units: what follows from what.

Everything rests on differences over windows of samples, so clocks that jitter, start anew or have
gaps, and coarse encoders, do little harm.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Booleans, Floats

WINDOW = 20
"""Samples of one window."""
_LARGEST_STEP = 5.0
"""Times the usual one: a longer step of the clock is a gap."""
MOVING_SHARE = 0.2
"""Of the greatest speed: faster than this an axis is moving, whatever its noise."""
_REST_SHARE = 0.02
_OUTLIER = 4.0
_LEAST_KEPT = 0.5
_LEAST_WINDOWS, _LEAST_STRONG = 5, 3


@dataclass(frozen=True, slots=True)
class Proportion:
    """target = factor * source over windows."""

    factor: float
    sigma: float  # standard deviation of the factor
    correlation: float  # of both over all windows
    residual: float  # root mean square of what is left of the target, in its unit


def usual_step(time_s: Floats) -> float:
    """Median step forward of a clock (n,), 0 where it stands."""
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if forward.size else 0.0


def whole_windows(time_s: Floats, window: int = WINDOW) -> Floats:
    """Bounds of windows without a gap or a new start of the clock, shape (n, 2), row numbers."""
    steps, usual = np.diff(time_s), usual_step(time_s)
    if not usual:
        return np.empty((0, 2), dtype=int)
    even = (steps > 0.0) & (steps < _LARGEST_STEP * usual)
    broken = np.concatenate([[0], np.cumsum(~even)])
    starts = np.arange(0, len(time_s) - window, window)
    kept = starts[broken[starts + window] == broken[starts]]
    return np.column_stack([kept, kept + window])


def changes(values: Floats, windows: Floats) -> Floats:
    """Change over each window, shape (n,)."""
    return np.asarray(values[windows[:, 1]] - values[windows[:, 0]])


def travelled(speed: Floats, time_s: Floats, windows: Floats) -> Floats:
    """Integral of a speed over each window, by the trapezoidal rule, shape (n,)."""
    pieces = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(pieces))])
    return changes(total, windows)


def proportion(target: Floats, source: Floats) -> Proportion | None:
    """Proportion of two series of changes, shape (n,) each; None where too little moves.

    Lost rows make jumps that no speed explains: what lies outside `_OUTLIER` robust standard
    deviations of the median ratio's line is left out.
    """
    known = np.isfinite(target) & np.isfinite(source)
    target, source = target[known], source[known]
    if len(source) < _LEAST_WINDOWS:
        return None
    strong = np.abs(source) > 0.5 * float(np.percentile(np.abs(source), 95.0))
    if np.count_nonzero(strong) < _LEAST_STRONG:
        return None
    line = float(np.median(target[strong] / source[strong]))
    off = np.abs(target - line * source)
    spread = 1.4826 * float(np.median(off[strong]))
    kept = off <= max(_OUTLIER * spread, 1e-9 * float(np.abs(target).max()))
    share = float(np.mean(kept))
    target, source = target[kept], source[kept]
    power, other = float(np.sum(source**2)), float(np.sum(target**2))
    if share < _LEAST_KEPT or len(source) < _LEAST_WINDOWS or power <= 0.0 or other <= 0.0:
        return None
    factor = float(np.sum(target * source)) / power
    left = target - factor * source
    residual = math.sqrt(float(np.mean(left**2)))
    sigma = residual * math.sqrt(len(left) / (len(left) - 1.0) / power)
    return Proportion(factor, sigma, factor * math.sqrt(power / other), residual)


def directions(speed: Floats) -> tuple[Booleans, Booleans, Booleans]:
    """Samples that move forwards, backwards, and rest; shape (n,) each."""
    magnitude = np.abs(speed)
    top = float(np.nanpercentile(magnitude, 99.0)) if speed.size else 0.0
    moving = magnitude > MOVING_SHARE * top
    return moving & (speed > 0), moving & (speed < 0), magnitude <= _REST_SHARE * top


def smoothed_speed(position: Floats, time_s: Floats, window: int = WINDOW) -> Floats:
    """Speed from a position over a sliding window of samples, shape (n,); NaN at gaps and ends."""
    half, usual = window // 2, usual_step(time_s) * 2 * (window // 2)
    result = np.full(len(position), np.nan)
    if len(position) <= 2 * half or not usual:
        return result
    span = time_s[2 * half :] - time_s[: -2 * half]
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = (position[2 * half :] - position[: -2 * half]) / span
    good = (span > 0.0) & (span < 2.0 * usual)
    result[half:-half] = np.where(good, speed, np.nan)
    return result


def is_unsigned(effort: Floats, speed: Floats) -> bool:
    """Effort that keeps one sign where friction, in both directions, changes it.

    A load that pulls one way, such as gravity, keeps the sign too, but it differs between the
    directions by twice the friction, and is as large at rest.
    """
    forwards, backwards, rest = directions(speed)
    if min(np.count_nonzero(forwards), np.count_nonzero(backwards)) < 10:
        return False
    up, down = float(np.nanmean(effort[forwards])), float(np.nanmean(effort[backwards]))
    strong = float(np.nanpercentile(np.abs(effort), 95.0))
    one_sign = float(np.nanpercentile(effort * np.sign(up or 1.0), 1.0)) > -0.05 * strong
    alike = abs(up - down) < 0.5 * abs(up + down)
    idle = float(np.nanmean(np.abs(effort[rest]))) if np.count_nonzero(rest) > 10 else 0.0
    return one_sign and alike and idle < 0.8 * 0.5 * abs(up + down)


def follows(effort: Floats, speed: Floats) -> float:
    """Share of an effort that friction explains, with its sign: -1 to 1."""
    forwards, backwards, _ = directions(speed)
    if min(np.count_nonzero(forwards), np.count_nonzero(backwards)) < 10:
        return 0.0
    spread = float(np.nanstd(effort[forwards | backwards]))
    half = 0.5 * (float(np.nanmean(effort[forwards])) - float(np.nanmean(effort[backwards])))
    return half / spread if spread > 0.0 else 0.0


def lags(later: Floats, earlier: Floats) -> float:
    """Samples by which one position comes after another: the least squares shift, up to 50."""
    most = min(50, len(later) // 4)
    centre = slice(most, len(later) - most)

    def left(shift: int) -> float:
        moved = earlier[most - shift : len(earlier) - most - shift]
        return float(np.nanvar(later[centre] - moved))

    return float(min(range(-most, most + 1), key=left))
