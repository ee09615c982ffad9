"""One phase of motion: every hypothesis drifts, is weighed with and without a process force, and
is corrected by what no force has spoiled.

The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

import numpy as np

from ...models.compiled import compiled, inlined
from .correction import correct
from .drift import drift
from .force import FORCED, OUTLIER, Verdicts, force_begins, judge, no_verdicts
from .hypotheses import follow_hypotheses, leader_of, normalise
from .innovation import Innovation, innovate, noise_of
from .state import (
    FORCED_S,
    INERTIA_ERROR,
    INERTIA_TORQUE,
    STOPPED_S,
    SURPRISE,
    TORQUE_STATES,
    AxisModel,
    Bank,
    Process,
    Reading,
)

_INERTIA_S = 30.0
_USUAL = 6.0
"""Innovation squared that two quantities exceed in 5 % of all phases."""


@compiled
def take(
    bank: Bank, model: AxisModel, process: Process, reading: Reading, elapsed_s: float
) -> float:
    """Take one phase.

    Args:
        bank: changed in place.
        elapsed_s: since the phase before.

    Returns:
        Normalised innovation squared per quantity of the leading hypothesis; about 1 is expected.
        NaN if it takes the phase for one under a process force, which teaches nothing.
    """
    size = bank.mean.shape[1]
    two = size > TORQUE_STATES and not math.isnan(reading.stretch_m)
    room = Innovation(
        np.zeros((2, size)), np.zeros((2, size)), np.zeros(2), np.eye(2), np.zeros(size)
    )
    noise = noise_of(model, reading)
    begins = force_begins(bank, process, reading)
    hypotheses = bank.mean.shape[0]
    told, error_nm = no_verdicts(hypotheses), np.zeros(hypotheses)
    for k in range(hypotheses):
        if bank.alive[k] == 0:
            continue
        drift(bank, k, model, process, reading, elapsed_s)
        compliance = innovate(bank, k, model, process, reading, noise, two, room)
        error_nm[k] = room.error[0]
        judge(bank, k, model, process, begins, compliance, two, room, told)
        _learn(bank, k, model, told, two, room)
    _weigh(bank, process, told)
    leader = leader_of(bank)
    _watch_inertia(bank, model, reading, error_nm[leader])
    calm = bool(told.forced[leader] <= FORCED)
    bank.moments[SURPRISE] = told.nis[leader]
    follow_hypotheses(bank, process, reading, elapsed_s, calm)
    _count_forced(bank, process, reading, calm)
    if not calm:
        return math.nan
    return float(told.nis[leader] / 2.0 if two else told.nis[leader])


@inlined
def _learn(
    bank: Bank,
    k: int,
    model: AxisModel,
    told: Verdicts,
    two: bool,
    room: Innovation,
) -> None:
    """Correct a hypothesis by a phase that no force has spoiled.

    What it cannot explain teaches it nothing, but for the likeliest: that gives way by a little, or
    it would stand still where it errs, as after a long cut. A phase counts by the probability that
    no force acts, and no less: to widen it by the force that might act would make light of those
    phases that say something new, and of these alone.
    """
    forced, s = told.forced[k], room.covariance
    wild = told.nis[k] > OUTLIER
    if forced > FORCED or (wild and k != leader_of(bank)):
        return
    scale = max(1.0, told.nis[k] / _USUAL) / (1.0 - forced)
    correct(bank, k, model, scale * s[0, 0], scale * s[1, 1], scale * s[0, 1], two, room)


@inlined
def _weigh(bank: Bank, process: Process, told: Verdicts) -> None:
    """Weigh the hypotheses by what they expected of a phase; no phase alone condemns one.

    A phase that all take for one under a force says nothing: how an axis yields to a force is
    known too badly. While a force lasts, only what does not fit it counts, not how closely a
    rival that learns from the phase expects it.
    """
    most, least = -math.inf, 1.0
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            most, least = max(most, told.said[k]), min(least, told.forced[k])
    if least > FORCED:
        return
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            behind = min(most - told.said[k], process.most_nats)
            behind -= told.lasts[k] * max(behind - told.misfit[k], 0.0)
            bank.log_weight[k] -= process.evidence * behind
    normalise(bank, process.floor)


@inlined
def _watch_inertia(bank: Bank, model: AxisModel, r: Reading, error_nm: float) -> None:
    """Remember how far torque is from what acceleration takes, forces or not."""
    keep = math.exp(-r.steady_s / _INERTIA_S)
    inertia_nm = model.inertia_kg_m2 * r.acceleration_rad_s2
    bank.moments[INERTIA_ERROR] *= keep
    bank.moments[INERTIA_TORQUE] *= keep
    bank.moments[INERTIA_ERROR] += error_nm * inertia_nm * r.steady_s
    bank.moments[INERTIA_TORQUE] += inertia_nm * inertia_nm * r.steady_s


@inlined
def _count_forced(bank: Bank, process: Process, r: Reading, calm: bool) -> None:
    """Count how long a force has lasted; every so often it is doubted, as if the axis had stopped:
    another load or lubricant may be what looks like it."""
    if calm:
        bank.moments[FORCED_S] = 0.0
        return
    before_s = bank.moments[FORCED_S]
    bank.moments[FORCED_S] = before_s + r.steady_s
    if bank.moments[FORCED_S] % process.learn_s < before_s % process.learn_s:
        bank.moments[STOPPED_S] = max(bank.moments[STOPPED_S], 1.0)
