"""Hypotheses at the start and after a stop; challengers are spawned beside the accepted one.

No accepted hypothesis dies: every slot keeps a least weight, the one accepted before the last step
goes on beside the new one, and challengers are spawned every few seconds of motion, so that a wrong
answer is contested for as long as it stands.
"""

import math

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled
from . import state
from .model import Start
from .state import Bank, MixtureSettings, Process, Reading, empty_bank

FORCED = 0.2
"""Probability of a process force above which a phase corrects nothing."""
STOP_S = 1.0
"""Loads and lubricants are mostly changed while the axis stands, for at least this long."""
_LONGEST_STOP_S = 100.0
_SURPRISE, _SOON_S = 9.0, 0.3
_LEAST_SHARE = math.log(1e-3)
_ALIVE, _GAINED, _SLOW_S = 2.0, 1.0, 20.0
BOTH = 3
TOTAL_SHARE = 0.25
"""Of the motion that confirms a step, for a loss of all: the next stop may change load or lubricant
before the rest is seen, and those begin with what is accepted."""
LOST, LITTLE = 0.02, 0.25
"""Of the fresh preload: left after a loss of all; with less left, a step as large is a new nut."""
_SHARES = (*range(state.NUT_FRICTION, state.PAYLOAD), state.REVERSAL)
_IS_SHARE = np.isin(np.arange(state.STRETCH_STATES), _SHARES).astype(np.float64)
(_HALF, _HALF_SIGMA), (_NONE, _NONE_SIGMA) = (0.4, 0.4), (0.03, 0.7)
DAY_S = 86_400.0
_WORN_PER_DAY, _OTHER_LOAD, _OTHER_NUT, _UNSEEN = 0.03, 0.05, 0.25, 0.02
NUT_SLOT, LOAD_SLOT, LOST_SLOT, SOFT_SLOT = 2, 3, 4, 7
KEPT = (state.PRELOAD, state.LOOSENESS, state.COUPLING, state.NUT_COMPLIANCE, state.TABLE_MASS)
"""States carried over to the next session: considered ones err alike in all sessions."""


@compiled
def normalise(bank: Bank, floor: float) -> None:
    """Scale the weights of the living to a sum of 1; none falls below `floor` less its cost."""
    top, total = bank.log_weight[leader_of(bank)], 0.0
    for k in range(bank.log_weight.shape[0]):
        if bank.alive[k]:
            total += math.exp(bank.log_weight[k] - top)
    shift = top + math.log(total)
    for k in range(bank.log_weight.shape[0]):
        if bank.alive[k]:
            bank.log_weight[k] = max(bank.log_weight[k] - shift, floor - bank.cost[k])


@compiled
def adapt_hypotheses(
    bank: Bank, process: Process, reading: Reading, elapsed_s: float, calm: bool, nis: Floats
) -> None:
    """Promote a confirmed challenger after a phase, and spawn new ones.

    They begin with the phase that surprises the accepted hypothesis, and a loosening with one that
    surprises itself: each spawned before it has learned that nothing happened. A direction is seen
    once a phase in it is no surprise. `calm`: no force acts; `nis`: innovation squared, of each.
    """
    moments, motion_s = bank.moments, reading.steady_s
    moments[state.SINCE_SPAWN_S] += motion_s
    if elapsed_s > STOP_S:
        moments[state.STOPPED_S] = min(elapsed_s, _LONGEST_STOP_S)
    leader = leader_of(bank)
    if calm:
        bank.age_s[:] += motion_s * bank.alive * (bank.force <= FORCED)
        bank.directions[leader] |= (1 + (reading.direction <= 0.0)) * (nis[leader] <= _SURPRISE)
    if moments[state.LEARNING] > 0.0:
        if (bank.age_s * bank.alive).max() >= process.assumed.learn_s:
            _end_initialisation(bank, process)
        return
    base = accepted(bank)
    if _is_confirmed(bank, process, leader, base, calm):
        least = bank.log_weight[leader] - process.assumed.margin
        left = max(bank.log_weight[base], process.assumed.floor)
        _succeed(bank, process, leader, least, base, left)
        leader = base = state.STEADY
    priors = process.priors + math.log(process.assumed.spawn_s)
    if moments[state.STOPPED_S] > 0.0:
        stop_priors = np.maximum(process.stop_priors + math.log(moments[state.STOPPED_S]), priors)
        moments[state.STOPPED_S] = 0.0
        for k in (*state.STOP_CHALLENGERS, state.LOSS, state.TOTAL_LOSS):
            _spawn_unless_running(bank, process, k, base, leader, stop_priors[k], math.inf)
    since = moments[state.SINCE_SPAWN_S]
    surprised = moments[state.SURPRISE] > _SURPRISE and (since >= _SOON_S or not calm)
    if since >= process.assumed.spawn_s or surprised:
        moments[state.SINCE_SPAWN_S] = 0.0
        _restart(bank, state.STEADY, state.WEARING, process.assumed.steady_rate)
        _restart(bank, state.WEARING, state.STEADY, process.assumed.wear_rate)
        for k in state.CHALLENGERS:
            is_own = k >= state.LOOSENING and nis[k] > _SURPRISE
            anew = is_own or (surprised and k == state.LUBRICATION)
            stale_s = 2.0 * _SOON_S if anew else math.inf
            _spawn_unless_running(bank, process, k, base, leader, priors[k], stale_s)


@compiled
def leader_of(bank: Bank) -> int:
    """Slot of the likeliest hypothesis."""
    best, weight = state.STEADY, -math.inf
    for k in range(bank.alive.shape[0]):
        if bank.alive[k] and bank.log_weight[k] > weight:
            best, weight = k, bank.log_weight[k]
    return best


@compiled
def accepted(bank: Bank) -> int:
    """Slot of the accepted hypothesis, from which challengers are spawned: STEADY or WEARING."""
    weight = bank.log_weight
    wearing = bank.alive[state.WEARING] and weight[state.WEARING] > weight[state.STEADY]
    return state.WEARING if wearing else state.STEADY


@compiled
def _is_confirmed(bank: Bank, process: Process, leader: int, base: int, calm: bool) -> bool:
    """Return whether a challenger has led for long enough, in both directions, by a margin."""
    if leader in (state.STEADY, state.WEARING) or not calm:
        return False
    least_s = process.assumed.confirm_s * (TOTAL_SHARE if leader == state.TOTAL_LOSS else 1.0)
    seen = bank.age_s[leader] >= least_s and bank.directions[leader] == BOTH
    return bool(seen and bank.log_weight[leader] > bank.log_weight[base] + process.assumed.margin)


@compiled
def copy_to(bank: Bank, slot: int, source: int, log_weight: float) -> None:
    """Start a hypothesis as a copy of another."""
    if slot != source:
        bank.mean[slot] = bank.mean[source]
        bank.covariance[slot] = bank.covariance[source]
    bank.log_weight[slot], bank.cost[slot] = log_weight, bank.cost[source]
    bank.force[slot], bank.force_n[slot] = bank.force[source], bank.force_n[source]
    bank.alive[slot], bank.age_s[slot], bank.directions[slot] = 1, 0.0, 0


@compiled
def _end_initialisation(bank: Bank, process: Process) -> None:
    """End the initialisation: accept the likeliest, let the others that are likely go on beside it.

    Whether there is another load shows once the axis accelerates, which may be later.
    """
    best = leader_of(bank)
    others = np.where(bank.alive > 0, bank.log_weight, -np.inf)
    others[best] = -np.inf
    second = int(np.argmax(others))
    least = bank.log_weight[best] - 3.0 * process.assumed.margin
    _succeed(bank, process, best, least, second, others[second])
    bank.moments[state.LEARNING] = 0.0


@compiled
def _succeed(bank: Bank, process: Process, slot: int, least: float, old: int, left: float) -> None:
    """Accept a hypothesis, steady or wearing; `old` goes on as what was believed, weighing `left`.

    Challengers of weights above `least` go on, too: with one encoder much looks alike.
    """
    mean, covariance = bank.mean[old].copy(), bank.covariance[old].copy()
    force, force_n, cost = bank.force[old], bank.force_n[old], bank.cost[old]
    weight = bank.log_weight[slot]
    copy_to(bank, state.STEADY, slot, weight)
    if slot in (state.LOSS, state.TOTAL_LOSS):  # it may go on, and how much is vague
        _renew(bank, state.STEADY, state.WEAR_RATE, 0.0, process.assumed.wear_rate)
    copy_to(bank, state.WEARING, state.STEADY, weight + math.log(process.assumed.wearing))
    _renew(bank, state.WEARING, state.WEAR_RATE, 0.0, process.assumed.wear_rate)
    for k in state.CHALLENGERS:
        if k in (slot, old) or bank.log_weight[k] < least:
            bank.alive[k] = 0
    bank.moments[state.SINCE_SPAWN_S] = process.assumed.spawn_s
    bank.mean[state.BEFORE], bank.covariance[state.BEFORE] = mean, covariance
    bank.force[state.BEFORE], bank.force_n[state.BEFORE] = force, force_n
    bank.cost[state.BEFORE] = cost
    copy_to(bank, state.BEFORE, state.BEFORE, left)


@compiled
def _renew(bank: Bank, slot: int, i: int, value: float, sigma: float) -> None:
    """Set an element of the state anew, without correlation to the others."""
    x, p = bank.mean[slot], bank.covariance[slot]
    x[i], p[i, :], p[:, i] = value, 0.0, 0.0
    p[i, i] = sigma * sigma


@compiled
def _restart(bank: Bank, slot: int, other: int, rate: float) -> None:
    """Restart a slot from the other, with a wear rate of its own, once it has hardly any weight."""
    least = bank.log_weight[other] + _LEAST_SHARE
    if bank.alive[slot] == 0 or bank.log_weight[slot] < least:
        copy_to(bank, slot, other, least)
        _renew(bank, slot, state.WEAR_RATE, 0.0, rate)


@compiled
def _spawn_unless_running(
    bank: Bank, process: Process, slot: int, base: int, leader: int, prior: float, stale_s: float
) -> None:
    """Spawn a challenger beside the accepted hypothesis, unless one of its kind is in the running.

    A loss shows within seconds, and makes room once it says what is accepted. Others run on while
    they gain or explain what the likeliest takes for a force, until they are stale.
    """
    ahead = bank.log_weight[slot] - bank.log_weight[base]
    lasts_s = process.assumed.spawn_s if slot in (state.LOSS, state.TOTAL_LOSS) else math.inf
    gains = ahead > prior + _GAINED and bank.age_s[slot] < lasts_s
    may_gain = slot >= state.LOOSENING and bank.age_s[slot] < _SLOW_S  # as a slack belt, slowly
    gains |= may_gain and ahead > prior - _GAINED and bank.force[leader] <= FORCED
    explains = bank.force[leader] > FORCED and bank.force[slot] <= FORCED
    goes_on = ahead > -_ALIVE or ((gains or explains) and bank.age_s[slot] <= stale_s)
    if bank.age_s[slot] > lasts_s:
        apart = abs(bank.mean[slot, state.PRELOAD] - bank.mean[base, state.PRELOAD])
        goes_on &= apart > math.sqrt(bank.covariance[slot, state.PRELOAD, state.PRELOAD])
    if not (bank.alive[slot] and (slot == leader or goes_on)) and prior > -math.inf:
        spawn_challenger(bank, process, slot, base, bank.log_weight[base] + prior)


@compiled
def spawn_challenger(bank: Bank, process: Process, slot: int, base: int, log_weight: float) -> None:
    """Start a hypothesis as another one to which its step has just happened."""
    copy_to(bank, slot, base, log_weight)
    bank.force[slot] = 0.0
    x, p = bank.mean[slot], bank.covariance[slot]
    if slot == state.TOTAL_LOSS:
        level, sigma = process.fresh_log_percent, process.assumed.start
        if x[state.PRELOAD] > level + math.log(LITTLE):
            level, sigma = level + math.log(LOST), process.assumed.lost_sigma
        _renew(bank, slot, state.PRELOAD, level, sigma)
    if slot == state.LOAD:
        _renew(bank, slot, state.PAYLOAD, 0.0, 0.0)
    if x.shape[0] > state.TORQUE_STATES:
        x[state.LOOSENESS] += process.loosened_m_per_n[slot]
        x[state.COUPLING] += process.loosened_m_per_n[slot]
    p += process.jumps[slot]
    if slot == state.LUBRICATION:  # or all friction is as commissioned again
        back = x * _IS_SHARE[: x.shape[0]]
        p += np.outer(back, back)


def initial_bank(start: Start, settings: MixtureSettings) -> Bank:
    """Hypotheses at the start, until one is accepted: preloads, with and without a load."""
    bank = empty_bank(len(start.mean))
    fresh = 1.0 - settings.used - settings.half - settings.none
    levels = [(1.0, settings.start, fresh), (_HALF, _HALF_SIGMA, settings.half)]
    levels += [(_NONE, _NONE_SIGMA, settings.none)]
    loads = ((0.0, 1.0 - settings.loaded), (1.0, settings.loaded))
    slots = iter((state.STEADY, *state.CHALLENGERS))
    for load, load_share in loads:
        for share, sigma, level_share in levels:
            if load_share * level_share <= 0.0:
                continue
            slot = next(slots)
            bank.mean[slot] = start.mean
            bank.mean[slot, state.PRELOAD] += math.log(share)
            bank.covariance[slot] = start.covariance + load * start.other_load
            bank.covariance[slot, state.PRELOAD, state.PRELOAD] = sigma**2
            if load:
                _renew(bank, slot, state.TORQUE_SCALE, 0.0, 0.0)
            bank.log_weight[slot], bank.alive[slot] = math.log(load_share * level_share), 1
    _soften(bank, start, settings.softer)
    _restart(bank, state.WEARING, state.STEADY, settings.wear_rate)
    if settings.used > 0.0:
        copy_to(bank, state.BEFORE, state.STEADY, math.log(settings.used))
        bank.covariance[state.BEFORE, state.PRELOAD, state.PRELOAD] = settings.used_sigma**2
    bank.moments[state.LEARNING] = 1.0
    return bank


def _soften(bank: Bank, start: Start, share: float) -> None:
    """Add that joints have loosened unseen: behind them the preload may be any."""
    if start.softer.any():
        copy_to(bank, SOFT_SLOT, state.STEADY, math.log(share))
        fresh = bank.mean[SOFT_SLOT, state.PRELOAD]
        _renew(bank, SOFT_SLOT, state.PRELOAD, fresh, _NONE_SIGMA)
        bank.mean[SOFT_SLOT] += 0.5 * start.softer
        bank.covariance[SOFT_SLOT] += np.diag(start.softer**2)


def continue_after_stop(bank: Bank, start: Start, stopped_s: float) -> None:
    """Renew the hypotheses after an unobserved stop, in place.

    Friction is another day's, the screw has grown anew and may have worn; another load may be on
    the table, joints may be looser, and the longer the stop the likelier another nut is in. As at
    the start, these stand for themselves until the likeliest is accepted.
    """
    bank.cost[:] = bank.force[:] = bank.force_n[:] = 0.0
    if bank.moments[state.LEARNING] > 0.0:
        for k in range(len(bank.alive)):
            _age(bank, k, start, stopped_s)
        return
    base = accepted(bank)
    other_nut = -_OTHER_NUT * math.expm1(-max(stopped_s, 1.0) / DAY_S)
    copy_to(bank, state.STEADY, base, math.log(1.0 - _OTHER_LOAD - other_nut - 2.0 * _UNSEEN))
    _age(bank, state.STEADY, start, stopped_s)
    bank.alive[state.STEADY + 1 :] = 0
    copy_to(bank, NUT_SLOT, state.STEADY, math.log(other_nut))
    sigma = math.sqrt(start.covariance[state.PRELOAD, state.PRELOAD])
    _renew(bank, NUT_SLOT, state.PRELOAD, start.mean[state.PRELOAD], sigma)
    if len(start.mean) > state.TORQUE_STATES:
        copy_to(bank, LOAD_SLOT, state.STEADY, math.log(_OTHER_LOAD))
        _renew(bank, LOAD_SLOT, state.PAYLOAD, 0.0, 0.0)
        _renew(bank, LOAD_SLOT, state.TORQUE_SCALE, 0.0, 0.0)
        bank.covariance[LOAD_SLOT] += start.other_load
        copy_to(bank, LOST_SLOT, state.STEADY, math.log(_UNSEEN))
        lost = bank.mean[LOST_SLOT, state.PRELOAD] + math.log(_HALF)
        _renew(bank, LOST_SLOT, state.PRELOAD, lost, _NONE_SIGMA)
        _soften(bank, start, _UNSEEN)
    bank.moments[:] = 0.0
    bank.moments[state.LEARNING] = 1.0


def _age(bank: Bank, slot: int, start: Start, stopped_s: float) -> None:
    """Begin a new session from the preload and the looseness of the last one."""
    kept = [*KEPT] if len(start.mean) > state.TORQUE_STATES else [state.PRELOAD]
    mean, covariance, square = start.mean.copy(), start.covariance.copy(), np.ix_(kept, kept)
    mean[kept] = bank.mean[slot, kept]
    covariance[kept, :] = covariance[:, kept] = 0.0
    covariance[square] = bank.covariance[slot][square]
    covariance[state.PRELOAD, state.PRELOAD] += _WORN_PER_DAY**2 * stopped_s / DAY_S
    bank.mean[slot], bank.covariance[slot] = mean, covariance
