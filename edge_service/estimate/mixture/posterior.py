"""Joint posterior of the hypotheses: values with 95 % intervals, and probabilities."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ...models.compiled import compiled
from ...models.machine import Machine
from ...models.screw.nut_law import LEAST_NUT_LOAD_PERCENT
from ..imm.modes import LEVEL_NAMES, LEVELS_PERCENT
from . import state
from .hypotheses import BOTH, FORCED, TOTAL_SHARE, accepted
from .state import AxisModel, Bank, MixtureSettings
from .torque_alone import CELLS, below, quantile, slicker, weigh

Rows = npt.NDArray[np.int64]
Parts = tuple[Floats, Floats, float, Floats]
"""Means and standard deviations, (n,), the bound, and the probability of each part below it."""
FAULTS = ("preload_loss", "lubrication", "process_force")
TABLE_FAULTS = ("payload", "looseness")
"""Faults that only the second encoder shows."""
MODEL_ERROR = 0.015
"""Error of ln(preload) by the cube root law and the drag's proportion near a fresh preload."""
MODEL_ERROR_SHARE, DRAG_ERROR_SHARE = 0.15, 0.02
"""Its growth with the distance from the fresh preload, as a share: the exponent of the nut's law,
1/3 for Hertz contacts, is known to 15 % (assumed); error of the drag per preload."""
LAW_FACTORS, LAW_WEIGHTS = np.array([0.6, 1.0, 2.0]), np.array([0.1, 0.8, 0.1])
"""Of ln(preload / fresh) and their probabilities (assumed): a nut that yields more than is thought
or stands on a soft spring, Hertz contacts, and rollers, whose exponent is 1/6."""
UNDETERMINED_SHARE, UNDETERMINED_HIGH_SHARE = 0.3, 0.12
"""An interval that holds half of the first share of the fresh preload, with an answer below it,
reaches down to none, for a clearance may be there; any reaches up to the second at least."""
OPENING = 2.0**1.5
"""Axial force over the preload from which on one half of the nut is unloaded (Hertz contacts)."""
READ_ABOVE = 0.15
"""Reach of ln(preload) above its bound for the median: cut there, a fresh one would read low."""
LOST_SHARE, SLICK_SHARE, PAYLOAD_SHARE, LOOSE_SHARE = 0.1, 0.2, 0.1, 0.1
"""Changes since commissioning that count as faults: of preload, friction, mass, compliance."""
LASTED_S = 1.0
"""Motion under a force, as is believed, from which on a step that needs none is doubted."""
DOUBTED = 0.4
"""Most weight of challengers that are new."""
_EDGES = tuple(0.5 * (a + b) for a, b in pairwise(LEVELS_PERCENT))
_STIFFNESS, _LEVEL, _FAULT = 6, 9, 9 + len(LEVEL_NAMES)
_SIZE = _FAULT + len(FAULTS) + len(TABLE_FAULTS)
_HALVINGS = 26


class FaultLimits(NamedTuple):
    """Limits of one axis beyond which a change counts as a fault."""

    error_share: float
    mass_tolerance: float  # NaN where the stiffness is unknown
    coulomb_nm: float
    assumed: MixtureSettings  # what friction may do
    widening: float = 1.0  # of the errors: innovations are larger than expected


class Posterior(NamedTuple):
    """Posterior of one axis: values with 95 % intervals, and probabilities."""

    preload: tuple[float, float, float]  # percent; the median of the mixture
    drag: tuple[float, float, float]  # Coulomb torque of the whole axis, N m
    stiffness: tuple[float, float, float] | None  # at the reference, N/m; None with one encoder
    levels: dict[str, float]  # that each of the thesis' levels is the nearest
    faults: dict[str, float]  # each change since commissioning that this axis can show


def fault_limits(machine: Machine, model: AxisModel, assumed: MixtureSettings) -> FaultLimits:
    """Fault limits of a commissioned axis, and what its friction may do."""
    commissioned, drag, mass = machine.commissioned, machine.model.preload_drag_nm, machine.model
    assert commissioned is not None
    table = mass.table_mass_kg if model.compliance_m_per_n > 0.0 else None
    error = DRAG_ERROR_SHARE if drag is None else max(DRAG_ERROR_SHARE, drag.tolerance)
    tolerance = math.nan if table is None else table.tolerance
    return FaultLimits(error, tolerance, commissioned.coulomb_nm, assumed)


def posterior_of(bank: Bank, model: AxisModel, limits: FaultLimits) -> Posterior:
    """Posterior of a bank of hypotheses."""
    values = packed_posterior(bank, model, limits).tolist()
    names = FAULTS if bank.mean.shape[1] == state.TORQUE_STATES else (*FAULTS, *TABLE_FAULTS)
    return Posterior(
        tuple(values[:3]),
        tuple(values[3:6]),
        None if math.isnan(values[_STIFFNESS]) else tuple(values[_STIFFNESS:_LEVEL]),
        dict(zip(LEVEL_NAMES, values[_LEVEL:_FAULT], strict=True)),
        dict(zip(names, values[_FAULT:], strict=False)),
    )


@compiled
def packed_posterior(bank: Bank, model: AxisModel, limits: FaultLimits) -> Floats:
    """Preload, drag and stiffness with their intervals, levels, faults; (_SIZE,)."""
    values = np.full(_SIZE, math.nan)
    rows = np.flatnonzero(bank.alive)
    weight = np.exp(bank.log_weight[rows])
    weight /= np.sum(weight)
    firm = _doubt_new(bank, rows, weight, limits.assumed)
    mean, sigma = _log_preloads(bank, model, limits, rows)
    values[3], values[4], values[5] = _drag(bank, model, rows, weight)
    wide = sigma * limits.widening
    values[6], values[7], values[8] = _stiffness(bank, model, limits, rows, weight, mean, wide)
    of_laws, mean, sigma = _by_laws(weight, mean, sigma, model)
    most = math.log(state.MOST_SHARE * model.fresh_percent)
    read = _cut(mean, sigma, most + READ_ABOVE)
    values[0] = min(_quantile(0.5, firm, read), model.fresh_percent)
    parts = _cut(mean, sigma * limits.widening, most)
    values[1], values[2] = _interval(of_laws, parts, model)
    values[1], values[2] = min(values[1], values[0]), max(values[2], values[0])
    middle = [_below(math.log(edge), of_laws, parts) for edge in _EDGES]
    values[_LEVEL:_FAULT] = 0.0 - np.diff(np.array([1.0, *middle, 0.0]))
    lost = math.log((1.0 - LOST_SHARE) * model.fresh_percent)
    values[_FAULT] = _below(lost, of_laws, parts)
    of = np.zeros(bank.mean.shape[1])
    of[state.NUT_FRICTION] = model.drag_per_percent_nm * model.fresh_percent
    of[state.BEARING_FRICTION] = model.bearing_nm
    of[state.GUIDE_FRICTION] = model.ratio_m_per_rad * model.guide_n
    values[_FAULT + 1] = _above(bank, rows, weight, of, SLICK_SHARE * limits.coulomb_nm)
    values[_FAULT + 2] = np.sum(weight * bank.force[rows])
    if bank.mean.shape[1] > state.TORQUE_STATES:
        of[:], limit = 0.0, PAYLOAD_SHARE * model.table_mass_kg
        of[state.PAYLOAD] = 1.0
        values[_FAULT + 3] = _above(bank, rows, weight, of, limit)
        values[_FAULT + 3] += _above(bank, rows, weight, -of, limit)
        of[state.PAYLOAD], limit = 0.0, LOOSE_SHARE * model.compliance_m_per_n
        of[state.LOOSENESS] = of[state.COUPLING] = 1.0
        lost = math.log(UNDETERMINED_SHARE * model.fresh_percent)  # below, a nut yields by itself
        values[_FAULT + 4] = 1.0 - _below(lost, of_laws, parts)
        values[_FAULT + 4] *= _above(bank, rows, weight, of, limit)
    if bank.mean.shape[1] == state.TORQUE_STATES and limits.assumed.together > 0.0:
        _of_torque_alone(bank, model, limits, rows, weight, values)
    values[_LEVEL:] = np.clip(values[_LEVEL:], 0.0, 1.0)
    return values


@compiled
def _doubt_new(bank: Bank, rows: Rows, weight: Floats, assumed: MixtureSettings) -> Floats:
    """Let challengers only widen the answer that are new, by a force or upwards.

    New: they have led in one direction, or for less than the shortest time that confirms a step
    (a screw that grows unevenly looks like one until the axis turns). By a force: their own, one
    that acts for longer, or any where forces come and go. Returns the median's weights, by laws.
    """
    believed, doubted = accepted(bank), np.zeros(len(rows))
    rises = bank.mean[:, state.PRELOAD][rows] > bank.mean[believed, state.PRELOAD]
    forced_s, least_s = bank.moments[state.BELIEVED_FORCED_S], TOTAL_SHARE * assumed.confirm_s
    cuts = bank.moments[state.PAST_FORCED_S] > LASTED_S
    for i in range(len(rows)):
        k = rows[i]
        by_force = bank.force[k] > FORCED or forced_s > (0.0 if cuts else bank.age_s[k] + LASTED_S)
        new = bank.directions[k] != BOTH or (by_force and bank.age_s[k] < least_s)
        if k > state.WEARING and new and (by_force or rises[i]):
            doubted[i] = weight[i]
    own, share = np.searchsorted(rows, believed), np.sum(doubted)
    if share > DOUBTED:
        weight -= (1.0 - DOUBTED / share) * doubted
        weight[own] += share - DOUBTED
    firm = weight * ((doubted == 0.0) | rises)
    firm[own] += 1.0 - np.sum(firm)
    return np.outer(firm, LAW_WEIGHTS).ravel()


@compiled
def _of_torque_alone(
    bank: Bank, model: AxisModel, limits: FaultLimits, rows: Rows, weight: Floats, values: Floats
) -> None:
    """Preload, levels and faults of an axis with one encoder, from its dry friction, in place.

    A challenger that is not accepted widens the interval, and moves nothing: with torque alone a
    cut may pass for anything for some seconds.
    """
    fresh = model.fresh_percent
    fresh_nm = model.drag_per_percent_nm * fresh
    other_nm = limits.coulomb_nm - fresh_nm
    friction = (limits.assumed.warmth, limits.assumed.together, limits.assumed.apart)
    limit_nm = other_nm + SLICK_SHARE * limits.coulomb_nm
    every, firm, up = np.zeros(CELLS), np.zeros(CELLS), 0.0
    for i in range(len(rows)):
        k = rows[i]
        level_nm, variance = _coulomb(bank.mean[k], bank.covariance[k], model)
        sigma_nm = math.sqrt(variance)
        mine = weigh(level_nm, sigma_nm, fresh_nm, other_nm, limits.error_share, friction)
        every += weight[i] * mine
        if bank.moments[state.LEARNING] > 0.0 or k in (state.STEADY, state.WEARING, state.BEFORE):
            firm += weight[i] * mine
            up += weight[i] * slicker(level_nm, sigma_nm, fresh_nm, limit_nm, mine)
    whole = np.sum(firm)
    firm = firm / whole if whole > 0.0 else every
    low = min(quantile(0.025, every), quantile(0.025, firm))
    high = max(quantile(0.975, every), quantile(0.975, firm), UNDETERMINED_HIGH_SHARE)
    values[0] = fresh * quantile(0.5, firm)
    values[1], values[2] = fresh * low if low > LOST_SHARE else 0.0, fresh * high
    middle = [below(edge / fresh, firm) for edge in _EDGES]
    values[_LEVEL:_FAULT] = 0.0 - np.diff(np.array([1.0, *middle, 0.0]))
    values[_FAULT] = below(1.0 - LOST_SHARE, firm)
    values[_FAULT + 1] = up / whole if whole > 0.0 else 0.0


@compiled
def _log_preloads(
    bank: Bank, model: AxisModel, limits: FaultLimits, rows: Rows
) -> tuple[Floats, Floats]:
    """Mean and standard deviation of ln(preload) of the hypotheses, with the model's error."""
    mean, sigma = np.empty(len(rows)), np.empty(len(rows))
    for i in range(len(rows)):
        mean[i] = bank.mean[rows[i], state.PRELOAD]
        share = max(MODEL_ERROR_SHARE, limits.error_share)
        share *= mean[i] - math.log(model.fresh_percent)
        variance = max(bank.covariance[rows[i], state.PRELOAD, state.PRELOAD], 0.0)
        sigma[i] = math.sqrt(variance + MODEL_ERROR * MODEL_ERROR + share * share)
    return mean, sigma


@compiled
def _by_laws(
    weight: Floats, mean: Floats, sigma: Floats, model: AxisModel
) -> tuple[Floats, Floats, Floats]:
    """Weights, means and standard deviations of the hypotheses times the laws of the nut.

    Nobody knows which law of stiffness it has: a loss is larger or smaller by LAW_FACTORS.
    """
    lost = np.minimum(mean - math.log(model.fresh_percent), 0.0)
    of_laws = np.repeat(mean, 3) + np.outer(lost, LAW_FACTORS - 1.0).ravel()
    return np.outer(weight, LAW_WEIGHTS).ravel(), of_laws, np.repeat(sigma, 3)


@compiled
def _normal(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


@compiled
def _cut(mean: Floats, sigma: Floats, most: float) -> Parts:
    """Parts of a mixture of ln(preload), which is `most` at most."""
    whole = [max(_normal((most - mean[k]) / sigma[k]), 1e-12) for k in range(len(mean))]
    return mean, sigma, most, np.array(whole)


@compiled
def _below(x: float, weight: Floats, parts: Parts) -> float:
    """Probability that ln(preload) lies below x."""
    total, (mean, sigma, most, whole) = 0.0, parts
    for k in range(len(weight)):
        total += weight[k] * min(_normal((min(x, most) - mean[k]) / sigma[k]) / whole[k], 1.0)
    return total


@compiled
def _quantile(probability: float, weight: Floats, parts: Parts) -> float:
    """Preload below which the mixture has a probability, %."""
    mean, sigma, high = parts[:3]
    low = min(np.min(mean - 8.0 * sigma), high - 1.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_low = _below(middle, weight, parts) < probability
        low, high = (middle, high) if is_low else (low, middle)
    return math.exp(0.5 * (low + high))


@compiled
def _interval(weight: Floats, parts: Parts, model: AxisModel) -> tuple[float, float]:
    """95 % interval, %.

    Under a standing force one half of a nut with less preload than `open_percent` carries nothing:
    how much less shows neither in its stiffness nor in its drag.
    """
    open_percent = abs(model.hanging_n) / OPENING * model.fresh_percent / model.fresh_preload_n
    lost_percent = UNDETERMINED_SHARE * model.fresh_percent
    low, high = _quantile(0.025, weight, parts), _quantile(0.975, weight, parts)
    is_low = low < 0.5 * lost_percent and _quantile(0.5, weight, parts) < lost_percent
    if low < open_percent or is_low:
        low = 0.0
    return low, max(high, UNDETERMINED_HIGH_SHARE * model.fresh_percent)


@compiled
def _coulomb(x: Floats, p: Floats, model: AxisModel) -> tuple[float, float]:
    """Mean, N m, and variance of the whole dry friction."""
    drag, of = model.drag_per_percent_nm * math.exp(x[state.PRELOAD]), np.zeros(len(x))
    of[state.NUT_FRICTION], of[state.BEARING_FRICTION] = drag, model.bearing_nm
    of[state.GUIDE_FRICTION] = model.ratio_m_per_rad * model.guide_n
    mean = drag + model.bearing_nm + of[state.GUIDE_FRICTION] + _sum(x, p, of)[0]
    of[state.PRELOAD], of[state.TORQUE_WANDER] = drag * (1.0 + x[state.NUT_FRICTION]), 1.0
    return mean, _sum(x, p, of)[1]


@compiled
def _drag(bank: Bank, model: AxisModel, rows: Rows, weight: Floats) -> tuple[float, float, float]:
    """Coulomb torque of the whole axis, N m."""
    value, square = 0.0, 0.0
    for i in range(len(rows)):
        mean, variance = _coulomb(bank.mean[rows[i]], bank.covariance[rows[i]], model)
        value += weight[i] * mean
        square += weight[i] * (variance + mean * mean)
    half = 1.96 * math.sqrt(max(square - value * value, 0.0))
    return value, value - half, value + half


@compiled
def _sum(x: Floats, p: Floats, of: Floats) -> tuple[float, float]:
    """Mean and variance of a sum over the state, each element times `of`."""
    mean, variance = 0.0, 0.0
    for i in range(len(of)):
        if of[i] != 0.0:
            mean += of[i] * x[i]
            for j in range(len(of)):
                variance += of[i] * of[j] * p[i, j]
    return mean, max(variance, 0.0)


@compiled
def _above(bank: Bank, rows: Rows, weight: Floats, of: Floats, limit: float) -> float:
    """Probability that a sum over the state, see `_sum`, lies above a limit."""
    total = 0.0
    for j in range(len(rows)):
        mean, variance = _sum(bank.mean[rows[j]], bank.covariance[rows[j]], of)
        total += weight[j] * _normal((mean - limit) / math.sqrt(max(variance, 1e-60)))
    return total


@compiled
def _stiffness(
    bank: Bank,
    model: AxisModel,
    limits: FaultLimits,
    rows: Rows,
    weight: Floats,
    log_percent: Floats,
    sigma: Floats,
) -> tuple[float, float, float]:
    """Series stiffness at the reference, N/m (5.3.2, 5.3.11): 1/k = C + C_n ((F_0/F)^(1/3) - 1)."""
    if math.isnan(limits.mass_tolerance) or bank.mean.shape[1] == state.TORQUE_STATES:
        return math.nan, math.nan, math.nan
    value, square, joints = 0.0, 0.0, np.zeros(bank.mean.shape[1])
    joints[state.LOOSENESS] = joints[state.COUPLING] = 1.0
    for i in range(len(rows)):
        k = rows[i]
        nut, percent = bank.mean[k, state.NUT_COMPLIANCE], math.exp(log_percent[i])
        root = (model.fresh_percent / max(percent, LEAST_NUT_LOAD_PERCENT)) ** (1.0 / 3.0)
        loose, variance = _sum(bank.mean[k], bank.covariance[k], joints)
        compliance = model.compliance_m_per_n + loose + nut * (root - 1.0)
        slope = nut * root / 3.0 if percent > LEAST_NUT_LOAD_PERCENT else 0.0
        variance += (slope * sigma[i]) ** 2 + (limits.mass_tolerance * compliance) ** 2
        nut_var = max(bank.covariance[k, state.NUT_COMPLIANCE, state.NUT_COMPLIANCE], 0.0)
        variance += (root - 1.0) ** 2 * nut_var
        value += weight[i] * compliance
        square += weight[i] * (variance + compliance * compliance)
    half = 1.96 * math.sqrt(max(square - value * value, 0.0))
    return 1.0 / value, 1.0 / (value + half), 1.0 / max(value - half, 0.1 * value)
