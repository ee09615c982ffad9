"""One phase of motion: every hypothesis drifts, is weighed with and without a process force, and
is corrected by what no force has spoiled.

The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled, inlined
from .correction import correct
from .drift import drift
from .hypotheses import follow_hypotheses, leader_of, normalise
from .innovation import Innovation, innovate, noise_of
from .state import (
    FASTEST_RAD_S,
    FORCED_S,
    INERTIA_ERROR,
    INERTIA_TORQUE,
    SURPRISE,
    TORQUE_STATES,
    AxisModel,
    Bank,
    Process,
    Reading,
)

FORCED = 0.2
"""Probability of a process force above which a phase teaches nothing."""
_OUTLIER = 20.0
_RAPID = 0.4
_INERTIA_S = 30.0


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
    forced_before = _force_prior(bank, process, reading)
    hypotheses = bank.mean.shape[0]
    said, error_nm = np.full(hypotheses, -math.inf), np.zeros(hypotheses)
    nis, forced = np.zeros(hypotheses), np.zeros(hypotheses)
    for k in range(hypotheses):
        if bank.alive[k] == 0:
            continue
        drift(bank, k, model, process, reading, elapsed_s)
        compliance = innovate(bank, k, model, process, reading, noise, two, room)
        error_nm[k] = room.error[0]
        nis[k], forced[k], said[k] = _learn(
            bank, k, model, process, forced_before, compliance, two, room
        )
    _weigh(bank, process, said)
    leader = leader_of(bank)
    _watch_inertia(bank, model, reading, error_nm[leader])
    calm = bool(forced[leader] <= FORCED)
    bank.force[0] = forced[leader]
    bank.moments[SURPRISE] = nis[leader]
    follow_hypotheses(bank, process, reading, elapsed_s, calm)
    if not calm:
        bank.moments[FORCED_S] += reading.steady_s
        return math.nan
    bank.moments[FORCED_S] = 0.0
    return float(nis[leader] / 2.0 if two else nis[leader])


@inlined
def _weigh(bank: Bank, process: Process, said: Floats) -> None:
    """Weigh the hypotheses by what they expected of a phase; no phase alone condemns one."""
    most = -math.inf
    for k in range(said.shape[0]):
        most = max(most, said[k])
    for k in range(said.shape[0]):
        if bank.alive[k]:
            bank.log_weight[k] += process.evidence * max(said[k], most - process.most_nats)
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
def _force_prior(bank: Bank, process: Process, r: Reading) -> float:
    """Probability that a process force acts: it lasts, and hardly begins in a rapid."""
    speed = abs(r.speed_rad_s)
    fastest = max(bank.moments[FASTEST_RAD_S], speed)
    bank.moments[FASTEST_RAD_S] = fastest
    begins = process.rapid_share if speed > _RAPID * fastest else process.force_share
    return float(process.force_stay * bank.force[0] + (1.0 - bank.force[0]) * begins)


@inlined
def _learn(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    forced_before: float,
    compliance: float,
    two: bool,
    room: Innovation,
) -> tuple[float, float, float]:
    """Weigh a hypothesis with and without a process force, and correct it unless one acts.

    A force F on the table shows as R F in the torque and as F times the compliance in the stretch.

    Returns:
        Innovation squared without a force, the probability of one, and the log-likelihood.
    """
    e, s = room.error, room.covariance
    ratio, force_var = model.ratio_m_per_rad, process.force_n * process.force_n
    uu, ss, us = s[0, 0], s[1, 1], s[0, 1]
    calm, nis = _log_likelihood(e, uu, ss, us)
    seen_n = e[0] / ratio
    if two:
        a, b = ss * ratio - us * compliance, uu * compliance - us * ratio
        seen_n = (a * e[0] + b * e[1]) / (a * ratio + b * compliance)
    doubt_m = process.force_error * seen_n * compliance
    extra_uu, extra_us = force_var * ratio * ratio, force_var * ratio * compliance
    extra_ss = force_var * compliance * compliance + doubt_m * doubt_m
    pushed, forced_nis = _log_likelihood(e, uu + extra_uu, ss + extra_ss, us + extra_us)
    calm += math.log(1.0 - forced_before)
    pushed += math.log(forced_before)
    top = max(calm, pushed)
    both = top + math.log(math.exp(calm - top) + math.exp(pushed - top))
    forced = math.exp(pushed - both)
    if forced <= FORCED:
        scale = (1.0 - forced) * max(1.0, nis / _OUTLIER)
        scale += forced * max(1.0, forced_nis / _OUTLIER)
        correct(
            bank,
            k,
            model,
            scale * (uu + forced * extra_uu),
            scale * (ss + forced * extra_ss),
            scale * (us + forced * extra_us),
            two,
            room,
        )
    return nis, forced, both


@inlined
def _log_likelihood(e: Floats, uu: float, ss: float, us: float) -> tuple[float, float]:
    """Log-likelihood with tails that an outlier does not outrun, and the innovation squared."""
    det = uu * ss - us * us
    nis = (ss * e[0] * e[0] - 2.0 * us * e[0] * e[1] + uu * e[1] * e[1]) / det
    if nis > _OUTLIER:
        return -0.5 * (_OUTLIER * (1.0 + math.log(nis / _OUTLIER)) + math.log(det)), nis
    return -0.5 * (nis + math.log(det)), nis
