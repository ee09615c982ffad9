"""What a mixture of hypotheses says about the axis: values with intervals, and probabilities."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..messages.samples import Floats
from ..models.compiled import compiled
from ..models.machine import Machine
from ..models.stiffness import LEAST_NUT_LOAD_PERCENT
from .fused_model import Start
from .fused_state import (
    DRY,
    GAIN,
    GUIDE,
    LUBE,
    MASS,
    NUT,
    PLAY,
    PRELOAD,
    RATE,
    RUB_NODES,
    STATES,
    WEARING,
    FusedModel,
    Mixture,
)
from .mixture_interval import interval, mixture_cdf
from .transition import LEVELS_PERCENT

MODEL_ERROR_SHARE = 0.02
"""Error of the cube root law, as a share of the way from the fresh preload."""
MODEL_ERROR_PERCENT = 0.12
LAG_S = 1.5
"""A preload that runs at a rate is followed with about this delay, s of motion."""
LEAST_KNOWN_PERCENT = 1.5
"""Below this nothing tells a preload from none: a clearance may be there."""
LOST_SHARE, SLICK_SHARE, RUB_SHARE, PAYLOAD_SHARE, GAIN_SHARE = 0.1, 0.2, 0.1, 0.1, 0.05
PLAY_M = 1.5e-6
"""Changes since commissioning that count as faults: of preload, whole friction, whole friction,
table mass, torque constant; and of the play."""
LEVELS = tuple(f"{level:g}" for level in LEVELS_PERCENT)
_EDGES = tuple(0.5 * (a + b) for a, b in pairwise(LEVELS_PERCENT))
FAULTS = ("preload_loss", "lubrication", "torque_constant", "process_force")
TABLE_FAULTS = ("payload", "backlash", "misalignment")
"""Those that only the second encoder shows."""
_STIFFNESS, _LEVEL, _FAULT = 6, 9, 9 + len(LEVELS)
_SIZE = _FAULT + len(FAULTS) + len(TABLE_FAULTS)


class Limits(NamedTuple):
    """What the mixture of one axis is held against; SI units, preload in percent."""

    error_share: float  # of the way from the fresh preload
    mass_tolerance: float  # NaN where the stiffness cannot be told
    lost_percent: float
    slick_nm: float
    payload_kg: float
    rub_n: float


class Answers(NamedTuple):
    """What is known of one axis: values with 95 % intervals, and probabilities.

    Attributes:
        preload: percent.
        drag: Coulomb torque of the whole axis, N m.
        stiffness: series stiffness at `reference_m`, N/m; None with one encoder.
        levels: probability that each of the seed's levels is the nearest.
        faults: probability of each change since commissioning that this axis can show.
    """

    preload: tuple[float, float, float]
    drag: tuple[float, float, float]
    stiffness: tuple[float, float, float] | None
    levels: dict[str, float]
    faults: dict[str, float]


def limits_of(machine: Machine, model: FusedModel, start: Start) -> Limits:
    """Limits of a commissioned axis."""
    taught, drag, mass = machine.commissioned, machine.model.preload_drag_nm, machine.model
    assert taught is not None
    table = mass.table_mass_kg if model.compliance_m_per_n > 0.0 else None
    ratio = model.ratio_m_per_rad
    return Limits(
        MODEL_ERROR_SHARE if drag is None else max(MODEL_ERROR_SHARE, drag.tolerance),
        math.nan if table is None else table.tolerance,
        (1.0 - LOST_SHARE) * model.fresh_percent,
        float(start.mean[DRY] + ratio * start.mean[GUIDE]) + SLICK_SHARE * taught.coulomb_nm,
        PAYLOAD_SHARE * model.table_mass_kg,
        RUB_SHARE * taught.coulomb_nm / ratio,
    )


def answers(mixture: Mixture, model: FusedModel, limits: Limits, two_encoders: bool) -> Answers:
    """Read a mixture."""
    told = read(mixture, model, limits).tolist()
    names = (*FAULTS, *TABLE_FAULTS) if two_encoders else FAULTS
    return Answers(
        tuple(told[:3]),
        tuple(told[3:6]),
        None if math.isnan(told[_STIFFNESS]) else tuple(told[_STIFFNESS:_LEVEL]),
        dict(zip(LEVELS, told[_LEVEL:_FAULT], strict=True)),
        dict(zip(names, told[_FAULT:], strict=False)),
    )


@compiled
def read(mixture: Mixture, model: FusedModel, limits: Limits) -> Floats:
    """Preload, drag and stiffness with their intervals, levels, faults; (_SIZE,)."""
    said = np.empty(_SIZE)
    weight = _weights(mixture)
    mean, sigma = _preloads(mixture, model, limits)
    percent = max(float(np.dot(weight, mean)), 0.0)
    low, high = interval(weight, mean, sigma, LEAST_KNOWN_PERCENT)
    said[0], said[1], said[2] = percent, min(low, percent), max(high, percent)
    said[3], said[4], said[5] = _drag(mixture, model, weight)
    said[6], said[7], said[8] = _stiffness(mixture, model, limits, weight, mean, sigma)
    above = 1.0
    for i in range(len(_EDGES)):
        below = mixture_cdf(_EDGES[i], weight, mean, sigma)
        said[_LEVEL + i] = above - below
        above = below
    said[_LEVEL + len(_EDGES)] = above
    said[_FAULT] = mixture_cdf(limits.lost_percent, weight, mean, sigma)
    said[_FAULT + 1] = _rest_above(mixture, model, weight, limits.slick_nm)
    said[_FAULT + 2] = _beyond(mixture, weight, GAIN, GAIN_SHARE)
    said[_FAULT + 3] = np.dot(weight, mixture.force[: len(weight)])
    said[_FAULT + 4] = _beyond(mixture, weight, MASS, limits.payload_kg)
    said[_FAULT + 5] = _above(mixture, weight, PLAY, PLAY_M)
    said[_FAULT + 6] = _rubbing(mixture, weight, limits.rub_n)
    for i in range(_FAULT, _SIZE):
        said[i] = min(max(said[i], 0.0), 1.0)
    return said


@compiled
def _weights(mixture: Mixture) -> Floats:
    weight = np.exp(mixture.log_weight[: mixture.alive[0]])
    weight /= weight.sum()
    return weight


@compiled
def _preloads(mixture: Mixture, model: FusedModel, limits: Limits) -> tuple[Floats, Floats]:
    """Means and standard deviations of the preload, %, one per hypothesis."""
    count = mixture.alive[0]
    mean, sigma = np.empty(count), np.empty(count)
    for k in range(count):
        mean[k] = mixture.mean[k, PRELOAD]
        scale = limits.error_share * (mean[k] - model.fresh_percent)
        lag = LAG_S * mixture.mean[k, RATE] if mixture.mode[k] == WEARING else 0.0
        systematic = scale * scale + MODEL_ERROR_PERCENT**2 + lag * lag
        sigma[k] = math.sqrt(max(mixture.covariance[k, PRELOAD, PRELOAD], 0.0) + systematic)
    return mean, sigma


@compiled
def _drag(mixture: Mixture, model: FusedModel, weight: Floats) -> tuple[float, float, float]:
    """Coulomb torque of the whole axis, N m."""
    value, square = 0.0, 0.0
    for k in range(len(weight)):
        mean, variance = _coulomb(mixture.mean[k], mixture.covariance[k], model, 1.0)
        value += weight[k] * mean
        square += weight[k] * (max(variance, 1e-30) + mean * mean)
    half = 1.96 * math.sqrt(max(square - value * value, 0.0))
    return value, value - half, value + half


@compiled
def _coulomb(x: Floats, p: Floats, model: FusedModel, screw: float) -> tuple[float, float]:
    """Mean, N m, and variance of k (screw + f) p + B + R G.

    That is all dry friction with `screw` 1, and what is no preload's with 0.
    """
    k_nm = model.drag_per_percent_nm
    rows = (PRELOAD, LUBE, DRY, GUIDE)
    slopes = (k_nm * (screw + x[LUBE]), k_nm * x[PRELOAD], 1.0, model.ratio_m_per_rad)
    variance = 0.0
    for i in range(len(rows)):
        for j in range(len(rows)):
            variance += slopes[i] * slopes[j] * p[rows[i], rows[j]]
    mean = slopes[0] * x[PRELOAD] + x[DRY] + model.ratio_m_per_rad * x[GUIDE]
    return mean, variance


@compiled
def _stiffness(
    mixture: Mixture,
    model: FusedModel,
    limits: Limits,
    weight: Floats,
    percent: Floats,
    sigma: Floats,
) -> tuple[float, float, float]:
    """Series stiffness at `reference_m`, N/m (5.3.2, 5.3.11): 1/k = C + C_n ((F_0/F)^(1/3) - 1)."""
    if math.isnan(limits.mass_tolerance):
        return math.nan, math.nan, math.nan
    value, square = 0.0, 0.0
    for k in range(len(weight)):
        nut = mixture.mean[k, NUT]
        load = max(percent[k], LEAST_NUT_LOAD_PERCENT)
        root = (model.fresh_percent / load) ** (1.0 / 3.0)
        compliance = model.compliance_m_per_n + nut * (root - 1.0)
        slope = nut * root / (3.0 * load) if percent[k] > LEAST_NUT_LOAD_PERCENT else 0.0
        variance = (slope * sigma[k]) ** 2 + (limits.mass_tolerance * compliance) ** 2
        variance += (root - 1.0) ** 2 * max(mixture.covariance[k, NUT, NUT], 0.0)
        value += weight[k] * compliance
        square += weight[k] * (variance + compliance * compliance)
    half = 1.96 * math.sqrt(max(square - value * value, 0.0))
    return 1.0 / value, 1.0 / (value + half), 1.0 / max(value - half, 0.1 * value)


@compiled
def _tail(limit: float, mean: float, variance: float) -> float:
    """Probability above a limit."""
    return 0.5 * math.erfc((limit - mean) / math.sqrt(2.0 * max(variance, 1e-30)))


@compiled
def _rest_above(mixture: Mixture, model: FusedModel, weight: Floats, limit_nm: float) -> float:
    total = 0.0
    for k in range(len(weight)):
        mean, variance = _coulomb(mixture.mean[k], mixture.covariance[k], model, 0.0)
        total += weight[k] * _tail(limit_nm, mean, variance)
    return total


@compiled
def _above(mixture: Mixture, weight: Floats, i: int, limit: float) -> float:
    total = 0.0
    for k in range(len(weight)):
        total += weight[k] * _tail(limit, mixture.mean[k, i], mixture.covariance[k, i, i])
    return total


@compiled
def _beyond(mixture: Mixture, weight: Floats, i: int, limit: float) -> float:
    total = _above(mixture, weight, i, limit)
    for k in range(len(weight)):
        total += weight[k] * _tail(limit, -mixture.mean[k, i], mixture.covariance[k, i, i])
    return total


@compiled
def _rubbing(mixture: Mixture, weight: Floats, limit_n: float) -> float:
    """Probability that the worst place rubs more than the mean of all by a limit."""
    first = mixture.mean.shape[1] - RUB_NODES
    if first < STATES:
        return 0.0
    tails = np.zeros(RUB_NODES)
    sums = np.empty(RUB_NODES)
    for k in range(len(weight)):
        x, p = mixture.mean[k, first:], mixture.covariance[k, first:, first:]
        for i in range(RUB_NODES):
            sums[i] = p[i].sum()
        mean, every = x.sum() / RUB_NODES, sums.sum() / RUB_NODES**2
        for i in range(RUB_NODES):
            variance = p[i, i] - 2.0 * sums[i] / RUB_NODES + every
            tails[i] += weight[k] * _tail(limit_n, x[i] - mean, variance)
    return float(tails.max())
