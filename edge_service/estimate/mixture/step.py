"""Step of the bank over one phase of motion: predict, weigh with and without a process force,
correct by phases free of force, and adapt the set of hypotheses.

The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

import numpy as np

from ...models.compiled import compiled, inlined
from .filter.correction import correct
from .filter.drift import drift
from .filter.force import FORCED, OUTLIER, Assessments, assess, empty_assessments, force_begins
from .filter.innovation import Innovation, innovate, noise_of
from .hypotheses import adapt_hypotheses, leader_of, normalise
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
_MOST_INERTIA_ERROR = 0.4
"""Of one phase's inertia torque: a cut must not speak for the rest."""
_USUAL = 6.0
"""Innovation squared that two quantities exceed in 5 % of all phases."""


@compiled
def step(
    bank: Bank, model: AxisModel, process: Process, reading: Reading, elapsed_s: float
) -> float:
    """Predict, weigh and correct every hypothesis with one phase.

    Args:
        bank: changed in place.
        elapsed_s: since the phase before.

    Returns:
        Normalised innovation squared per quantity of the leading hypothesis; about 1 is expected.
        NaN if it takes the phase for one under a process force, which corrects nothing.
    """
    size = bank.mean.shape[1]
    two = size > TORQUE_STATES and not math.isnan(reading.stretch_m)
    innovation = Innovation(
        np.zeros((2, size)), np.zeros((2, size)), np.zeros(2), np.eye(2), np.zeros(size)
    )
    noise = noise_of(model, reading)
    begins = force_begins(bank, process, reading)
    hypotheses = bank.mean.shape[0]
    assessed, error_nm = empty_assessments(hypotheses), np.zeros(hypotheses)
    for k in range(hypotheses):
        if bank.alive[k] == 0:
            continue
        drift(bank, k, model, process, reading, elapsed_s)
        compliance = innovate(bank, k, model, process, reading, noise, two, innovation)
        error_nm[k] = innovation.error[0]
        assess(bank, k, model, process, begins, compliance, two, innovation, assessed)
        _correct_unforced(bank, k, model, assessed, two, innovation)
    _reweigh(bank, process, assessed)
    leader = leader_of(bank)
    _watch_inertia(bank, model, reading, error_nm[leader], 1.0 - assessed.persists[leader])
    calm = bool(assessed.forced[leader] <= FORCED)
    bank.moments[SURPRISE] = assessed.nis[leader]
    adapt_hypotheses(bank, process, reading, elapsed_s, calm)
    _count_forced(bank, process, reading, calm)
    if not calm:
        return math.nan
    return float(assessed.nis[leader] / 2.0 if two else assessed.nis[leader])


@inlined
def _correct_unforced(
    bank: Bank,
    k: int,
    model: AxisModel,
    assessed: Assessments,
    two: bool,
    innovation: Innovation,
) -> None:
    """Correct a hypothesis by a phase free of process forces.

    A phase that it cannot explain does not correct it, except the likeliest one: that gives way by
    a little, or it would stand still where it errs, as after a long cut. A phase counts by the
    probability that no force acts, and no less: to widen it by the force that might act would
    discount exactly those phases that carry news.
    """
    forced, s = assessed.forced[k], innovation.covariance
    wild = assessed.nis[k] > OUTLIER
    if forced > FORCED or (wild and k != leader_of(bank)):
        return
    scale = max(1.0, assessed.nis[k] / _USUAL) / (1.0 - forced)
    correct(bank, k, model, scale * s[0, 0], scale * s[1, 1], scale * s[0, 1], two, innovation)


@inlined
def _reweigh(bank: Bank, process: Process, assessed: Assessments) -> None:
    """Update the weights by the likelihoods of a phase; no phase alone rules a hypothesis out.

    A phase that all take for one under a force is left out: the axis' compliance under a force is
    known too badly. While a force lasts, only the misfit to it counts, not how closely a rival
    that learns from the phase expects it.
    """
    most, least = -math.inf, 1.0
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            most, least = max(most, assessed.log_likelihood[k]), min(least, assessed.forced[k])
    if least > FORCED:
        return
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            behind = min(most - assessed.log_likelihood[k], process.most_nats)
            behind -= assessed.persists[k] * max(behind - assessed.misfit[k], 0.0)
            bank.log_weight[k] -= process.evidence * behind
    normalise(bank, process.floor)


@inlined
def _watch_inertia(
    bank: Bank, model: AxisModel, r: Reading, error_nm: float, counts: float
) -> None:
    """Accumulate the correlation of the torque's error with the inertia torque.

    A wrong torque constant errs alike in every phase, and passes for a force that begins anew in
    each. A process force errs by as much as the inertia torque in some, and lasts into the next.

    Args:
        counts: probability that no force lasts from the phase before.
    """
    keep = math.exp(-r.steady_s / _INERTIA_S)
    inertia_nm = model.inertia_kg_m2 * r.acceleration_rad_s2
    square, most = inertia_nm * inertia_nm, _MOST_INERTIA_ERROR * inertia_nm * inertia_nm
    bank.moments[INERTIA_ERROR] *= keep
    bank.moments[INERTIA_TORQUE] *= keep
    error = min(max(error_nm * inertia_nm, -most), most)
    bank.moments[INERTIA_ERROR] += counts * error * r.steady_s
    bank.moments[INERTIA_TORQUE] += counts * square * r.steady_s


@inlined
def _count_forced(bank: Bank, process: Process, r: Reading, calm: bool) -> None:
    """Time for which a force has lasted, updated; doubted at intervals as if the axis had stopped.

    Another load or lubricant may look like a lasting force.
    """
    if calm:
        bank.moments[FORCED_S] = 0.0
        return
    before_s = bank.moments[FORCED_S]
    bank.moments[FORCED_S] = before_s + r.steady_s
    if bank.moments[FORCED_S] % process.learn_s < before_s % process.learn_s:
        bank.moments[STOPPED_S] = max(bank.moments[STOPPED_S], 1.0)
