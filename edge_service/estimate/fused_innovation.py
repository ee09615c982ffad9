"""What a phase says against a hypothesis: torque and stretch less what it expects of them."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats
from ..models.compiled import compiled, inlined
from .fused_physics import (
    NearNodes,
    Spot,
    flank_variance,
    predict_stretch,
    predict_torque,
    turn_variance,
)
from .fused_state import PLAY, PRELOAD, STATES, FusedModel, Innovation, Reading

_LEAST_PERCENT = 0.02
_STRAIGHT = 0.05
_RELINEARISATIONS = 2


class Room(NamedTuple):
    """Room for what `innovate` works with."""

    at: Floats  # (n,), state around which the stretch is linear
    rows: npt.NDArray[np.int64]  # (n,), states on which a quantity depends


@compiled
def room_for_innovation(size: int) -> Innovation:
    """An innovation of `size` states, to be filled."""
    return Innovation(np.empty((2, size)), np.empty((2, size)), np.empty(2), np.empty((2, 2)))


@inlined
def innovate(
    model: FusedModel, x: Floats, p: Floats, r: Reading, spot: Spot, told: Innovation, room: Room
) -> float:
    """Fill `told`. The stretch is linear around where the correction leads, if the preload is too
    uncertain for one step.

    Returns the compliance there, m/N.
    """
    told.error[0] = r.torque_nm - predict_torque(model, x, r, spot, told.slopes[0])
    count = _project(told.slopes[0], p, spot.near, room.rows, told.gains[0])
    speed = max(abs(r.speed_rad_s), 1e-3)
    told.covariance[0, 0] = (
        _along(room.rows, count, told.slopes[0], told.gains[0])
        + model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
        + (0.3 * spot.stribeck_nm) ** 2
    )
    at = room.at
    for i in range(x.shape[0]):
        at[i] = x[i]
    c = _stretch(model, x, p, r, spot, told, room)
    if math.isnan(r.stretch_m) or p[PRELOAD, PRELOAD] < (_STRAIGHT * max(x[PRELOAD], 1.0)) ** 2:
        return c
    e, s = told.error, told.covariance
    for _ in range(_RELINEARISATIONS):
        det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
        a = (s[1, 1] * e[0] - s[0, 1] * e[1]) / det
        b = (s[0, 0] * e[1] - s[0, 1] * e[0]) / det
        for i in range(x.shape[0]):
            at[i] = x[i] + told.gains[0, i] * a + told.gains[1, i] * b
        at[PRELOAD] = max(at[PRELOAD], _LEAST_PERCENT)
        c = _stretch(model, x, p, r, spot, told, room)
    return c


@inlined
def _stretch(
    model: FusedModel,
    x: Floats,
    p: Floats,
    r: Reading,
    spot: Spot,
    told: Innovation,
    room: Room,
) -> float:
    """Fill the stretch's part of `told`, linear around `room.at`; the compliance, m/N."""
    slope, gains, at, s = told.slopes[1], told.gains[1], room.at, told.covariance
    error_m, compliance, doubt_var = 0.0, 0.0, 0.0
    if math.isnan(r.stretch_m):
        for i in range(x.shape[0]):
            slope[i] = 0.0
    else:
        predicted, compliance = predict_stretch(model, at, r, spot, slope)
        error_m = r.stretch_m - predicted
        doubt_var = flank_variance(r, at[PLAY], p[PLAY, PLAY], -slope[PLAY])
        doubt_var += turn_variance(at, p, r)
    rows = room.rows
    count = _project(slope, p, spot.near, rows, gains)
    for i in range(count):
        m = rows[i]
        error_m -= slope[m] * (x[m] - at[m])
    told.error[1] = error_m
    speed = max(abs(r.speed_rad_s), 1e-3)
    s[0, 1] = _along(rows, count, slope, told.gains[0])
    s[1, 0] = s[0, 1]
    s[1, 1] = _along(rows, count, slope, gains) + doubt_var
    s[1, 1] += model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    return compliance


@inlined
def _along(rows: npt.NDArray[np.int64], count: int, slope: Floats, gains: Floats) -> float:
    """H (P H'), of one quantity or of two."""
    total = 0.0
    for i in range(count):
        m = rows[i]
        total += slope[m] * gains[m]
    return total


@inlined
def _project(
    slope: Floats, p: Floats, near: NearNodes, rows: npt.NDArray[np.int64], gains: Floats
) -> int:
    """P H' of one quantity into `gains`; the states on which it depends, counted, in `rows`.

    No slope but the nearest nodes' is other than 0 along the stroke.
    """
    count = 0
    for m in range(STATES):
        if slope[m] != 0.0:
            rows[count] = m
            count += 1
    if near.growth >= 0:
        rows[count], rows[count + 1] = near.growth, near.growth + 1
        rows[count + 2], rows[count + 3] = near.rub, near.rub + 1
        count += 4
    _weigh(slope, p, rows, count, gains)
    return count


@inlined
def _weigh(
    slope: Floats, p: Floats, rows: npt.NDArray[np.int64], count: int, gains: Floats
) -> None:
    """The weighed sum of some rows, four at a time: each pass over `gains` costs as much."""
    for j in range(gains.shape[0]):
        gains[j] = 0.0
    whole = count - count % 4
    for m in range(0, whole, 4):
        a, b, c, d = rows[m], rows[m + 1], rows[m + 2], rows[m + 3]
        wa, wb, wc, wd = slope[a], slope[b], slope[c], slope[d]
        for j in range(gains.shape[0]):
            gains[j] += wa * p[a, j] + wb * p[b, j] + wc * p[c, j] + wd * p[d, j]
    for m in range(whole, count):
        a = rows[m]
        wa = slope[a]
        for j in range(gains.shape[0]):
            gains[j] += wa * p[a, j]
