"""Innovation of torque and stretch: measured less expected by a hypothesis."""

import math
from typing import NamedTuple

from ....messages.samples import Floats
from ....models.compiled import inlined
from ..state import (
    PRELOAD,
    AxisModel,
    Bank,
    Process,
    Reading,
)
from .physics import expected_stretch, expected_torque, stribeck, stroke_factor

_STRAIGHT = 0.05
_FARTHEST = 1.5
_STRIBECK_ERROR = 0.3


class Innovation(NamedTuple):
    """Innovation of torque and stretch, in arrays that are filled again for each hypothesis."""

    slopes: Floats  # H, (2, n)
    gains: Floats  # P H', (2, n)
    error: Floats  # (2,), N m and m
    covariance: Floats  # S, (2, 2)
    at: Floats  # (n,), state around which the stretch is linear


class Noise(NamedTuple):
    """Errors of a phase, independent of the hypothesis."""

    factor: float  # m(x)
    slow_nm: float  # St(v)
    torque_var: float
    stretch_var: float


@inlined
def noise_of(model: AxisModel, r: Reading) -> Noise:
    """Errors of one phase by its length and speed."""
    speed = max(abs(r.speed_rad_s), 1e-3)
    slow_nm = stribeck(model, r)
    torque = model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
    stretch = model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    return Noise(
        stroke_factor(model, r.table_m),
        slow_nm,
        torque + (_STRIBECK_ERROR * slow_nm) ** 2,
        stretch,
    )


@inlined
def innovate(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    r: Reading,
    noise: Noise,
    two: bool,
    innovation: Innovation,
) -> float:
    """Fill the innovation of hypothesis `k`; returns the compliance at the phase, m/N.

    The stretch is linear around where the correction leads, if the preload is too uncertain for
    one step. Axial friction that differs from phase to phase acts on torque and stretch alike.
    """
    x, p, at = bank.mean[k], bank.covariance[k], innovation.at
    size = x.shape[0]
    ratio = model.ratio_m_per_rad
    e, s = innovation.error, innovation.covariance
    axial = process.axial_n * process.axial_n
    compliance = 0.0
    for i in range(size):
        at[i] = x[i]
    straight = not two or p[PRELOAD, PRELOAD] < _STRAIGHT * _STRAIGHT
    for turn in range(1 if straight else 3):
        e[0] = r.torque_nm - expected_torque(
            model, at, r, noise.factor, noise.slow_nm, innovation.slopes[0]
        )
        s[0, 0] = noise.torque_var + axial * ratio * ratio
        s[1, 1], s[0, 1], e[1] = 1.0, 0.0, 0.0
        if two:
            stretch, compliance = expected_stretch(model, at, r, noise.factor, innovation.slopes[1])
            e[1] = r.stretch_m - stretch
            loose = process.loose_m * math.exp(-math.exp(at[PRELOAD]) / 0.3)
            s[1, 1] = noise.stretch_var + axial * compliance * compliance + loose * loose
            s[0, 1] = axial * ratio * compliance
        for i in range(size):
            away = x[i] - at[i]
            e[0] -= innovation.slopes[0, i] * away
            if two:
                e[1] -= innovation.slopes[1, i] * away
        _project(p, innovation.slopes[0], innovation.gains[0])
        s[0, 0] += _along(innovation.slopes[0], innovation.gains[0])
        if two:
            _project(p, innovation.slopes[1], innovation.gains[1])
            s[1, 1] += _along(innovation.slopes[1], innovation.gains[1])
            s[0, 1] += _along(innovation.slopes[1], innovation.gains[0])
        s[1, 0] = s[0, 1]
        if straight or turn == 2:
            break
        det = s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1]
        a = (s[1, 1] * e[0] - s[0, 1] * e[1]) / det
        b = (s[0, 0] * e[1] - s[0, 1] * e[0]) / det
        for i in range(size):
            at[i] = x[i] + innovation.gains[0, i] * a + innovation.gains[1, i] * b
        at[PRELOAD] = min(max(at[PRELOAD], x[PRELOAD] - _FARTHEST), x[PRELOAD] + _FARTHEST)
    return compliance


@inlined
def _project(p: Floats, slope: Floats, gain: Floats) -> None:
    """P H' of one quantity, from the rows on which it depends."""
    for j in range(gain.shape[0]):
        gain[j] = 0.0
    for i in range(gain.shape[0]):
        weight = slope[i]
        if weight != 0.0:
            for j in range(gain.shape[0]):
                gain[j] += weight * p[i, j]


@inlined
def _along(slope: Floats, gain: Floats) -> float:
    total = 0.0
    for i in range(slope.shape[0]):
        total += slope[i] * gain[i]
    return total
