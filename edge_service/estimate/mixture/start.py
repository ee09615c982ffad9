"""Where the hypotheses begin, and where they go on after a stop that nobody saw."""

import math

from .hypotheses import begin_challenger, believed, copy_to
from .model import MixtureSettings, Start
from .state import (
    BEFORE,
    CHALLENGERS,
    ENCODER_OFFSET,
    ENCODER_SLOPE,
    LEARNING,
    LOAD,
    LOSS,
    PRELOAD,
    SINCE_SPAWN_S,
    STEADY,
    STOPPED,
    TORQUE_STATES,
    WEARING,
    Bank,
    Process,
    empty_bank,
)

_HALF, _HALF_SIGMA = 0.4, 0.4
_NONE, _NONE_SIGMA = 0.03, 0.7
DAY_S = 86_400.0
_WORN_PER_DAY, _MOST_DAYS = 0.05, 4.0
_OTHER_LOAD, _OTHER_NUT = 0.3, 0.02


def begun(start: Start, settings: MixtureSettings) -> Bank:
    """Hypotheses of what the axis may be at the start: its preload, and its load.

    For the first seconds these stand for themselves; then the likeliest is believed.
    """
    bank = empty_bank(len(start.mean))
    fresh = 1.0 - settings.half - settings.none
    levels = (
        (1.0, settings.start, fresh),
        (_HALF, _HALF_SIGMA, settings.half),
        (_NONE, _NONE_SIGMA, settings.none),
    )
    loads = ((0.0, 1.0 - settings.loaded), (1.0, settings.loaded))
    slot = 0
    for load, load_share in loads:
        if load and len(start.mean) == TORQUE_STATES:
            continue
        for share, sigma, level_share in levels:
            bank.mean[slot] = start.mean
            bank.mean[slot, PRELOAD] += math.log(share)
            bank.covariance[slot] = start.covariance + load * start.load
            bank.covariance[slot, PRELOAD, PRELOAD] = sigma**2
            bank.log_weight[slot] = math.log(load_share * level_share)
            bank.alive[slot] = 1
            slot += 1
    bank.moments[LEARNING] = 1.0
    return bank


def go_on(bank: Bank, start: Start, process: Process, stopped_s: float) -> None:
    """Go on after a stop that nobody saw, in place.

    The screw has grown anew and may have worn; another load may be on the table, and even another
    nut may be in. What friction has done meanwhile the next phase's drift tells.
    """
    base = believed(bank)
    weight = bank.log_weight[base]
    if bank.moments[LEARNING] > 0.0:
        for k in range(len(bank.alive)):
            _age(bank, k, start, stopped_s)
        return
    copy_to(bank, STEADY, base, weight)
    _age(bank, STEADY, start, stopped_s)
    copy_to(bank, WEARING, STEADY, weight + process.wearing_log_weight)
    for k in (*CHALLENGERS, BEFORE):
        bank.alive[k] = 0
    begin_challenger(bank, process, LOSS, STEADY, weight + math.log(_OTHER_NUT))
    if len(start.mean) > TORQUE_STATES:
        begin_challenger(bank, process, LOAD, STEADY, weight + math.log(_OTHER_LOAD))
    bank.force[0] = 0.0
    bank.moments[SINCE_SPAWN_S] = 0.0
    bank.moments[STOPPED] = 0.0


def _age(bank: Bank, slot: int, start: Start, stopped_s: float) -> None:
    """Widen what a stop leaves unknown."""
    p = bank.covariance[slot]
    p[PRELOAD, PRELOAD] += _WORN_PER_DAY**2 * min(stopped_s / DAY_S, _MOST_DAYS)
    if len(start.mean) > TORQUE_STATES:
        for i in (ENCODER_OFFSET, ENCODER_SLOPE):
            p[i, :] = 0.0
            p[:, i] = 0.0
            p[i, i] = start.covariance[i, i]
