"""Initialisation of the hypotheses, and their continuation after an unobserved stop."""

import math

from .hypotheses import accepted, copy_to
from .model import MixtureSettings, Start
from .state import (
    CHALLENGERS,
    LEARNING,
    LOOSENESS,
    NUT_COMPLIANCE,
    PAYLOAD,
    PRELOAD,
    STEADY,
    TABLE_MASS,
    TORQUE_STATES,
    WEARING,
    Bank,
    empty_bank,
)

_HALF, _HALF_SIGMA = 0.4, 0.4
_NONE, _NONE_SIGMA = 0.03, 0.7
DAY_S = 86_400.0
_WORN_PER_DAY, _MOST_DAYS = 0.05, 4.0
_OTHER_LOAD, _OTHER_NUT = 0.3, 0.02
NUT_SLOT, LOAD_SLOT = 2, 3
KEPT = (PRELOAD, PAYLOAD, LOOSENESS, NUT_COMPLIANCE, TABLE_MASS)
"""States carried over to the next session: considered ones err alike in all sessions."""


def initial_bank(start: Start, settings: MixtureSettings) -> Bank:
    """Hypotheses of the axis at the start: levels of its preload, with and without a load.

    For the first seconds these stand for themselves, one of them free to wander (the half that is
    left, in the slot of wear); then the likeliest is accepted.
    """
    bank = empty_bank(len(start.mean))
    fresh = 1.0 - settings.half - settings.none
    levels = (
        (1.0, settings.start, fresh),
        (_HALF, _HALF_SIGMA, settings.half),
        (_NONE, _NONE_SIGMA, settings.none),
    )
    loads = ((0.0, 1.0 - settings.loaded), (1.0, settings.loaded))
    slots = iter((STEADY, WEARING, *CHALLENGERS))
    for load, load_share in loads:
        if load and len(start.mean) == TORQUE_STATES:
            continue
        for share, sigma, level_share in levels:
            if load_share * level_share <= 0.0:
                continue
            slot = next(slots)
            bank.mean[slot] = start.mean
            bank.mean[slot, PRELOAD] += math.log(share)
            bank.covariance[slot] = start.covariance + load * start.load
            bank.covariance[slot, PRELOAD, PRELOAD] = sigma**2
            bank.log_weight[slot] = math.log(load_share * level_share)
            bank.alive[slot] = 1
    bank.moments[LEARNING] = 1.0
    return bank


def continue_after_stop(bank: Bank, start: Start, stopped_s: float) -> None:
    """Renew the hypotheses after an unobserved stop, in place.

    Friction is another day's, the screw has grown anew and may have worn; another load may be on
    the table, and even another nut may be in. As at the start, these stand for themselves until
    the likeliest is accepted.
    """
    if bank.moments[LEARNING] > 0.0:
        for k in range(len(bank.alive)):
            _age(bank, k, start, stopped_s)
        return
    base = accepted(bank)
    copy_to(bank, STEADY, base, math.log(1.0 - _OTHER_LOAD - _OTHER_NUT))
    _age(bank, STEADY, start, stopped_s)
    bank.alive[STEADY + 1 :] = 0
    copy_to(bank, NUT_SLOT, STEADY, math.log(_OTHER_NUT))
    bank.mean[NUT_SLOT, PRELOAD] = start.mean[PRELOAD]
    _renew(bank, NUT_SLOT, PRELOAD, start.covariance[PRELOAD, PRELOAD])
    if len(start.mean) > TORQUE_STATES:
        copy_to(bank, LOAD_SLOT, STEADY, math.log(_OTHER_LOAD))
        bank.mean[LOAD_SLOT, PAYLOAD] = 0.0
        _renew(bank, LOAD_SLOT, PAYLOAD, 0.0)
        bank.covariance[LOAD_SLOT] += start.load
    bank.force[:] = 0.0
    bank.force_n[:] = 0.0
    bank.moments[:] = 0.0
    bank.moments[LEARNING] = 1.0


def _age(bank: Bank, slot: int, start: Start, stopped_s: float) -> None:
    """Begin a new session from the preload, the load and the looseness of the last one."""
    kept = KEPT if len(start.mean) > TORQUE_STATES else (PRELOAD,)
    mean, covariance = start.mean.copy(), start.covariance.copy()
    for i in kept:
        mean[i] = bank.mean[slot, i]
        covariance[i, :] = 0.0
        covariance[:, i] = 0.0
    for i in kept:
        for j in kept:
            covariance[i, j] = bank.covariance[slot, i, j]
    covariance[PRELOAD, PRELOAD] += _WORN_PER_DAY**2 * min(stopped_s / DAY_S, _MOST_DAYS)
    bank.mean[slot], bank.covariance[slot] = mean, covariance


def _renew(bank: Bank, slot: int, i: int, variance: float) -> None:
    """Remove the correlations of an element of the state, and set its variance."""
    p = bank.covariance[slot]
    p[i, :] = 0.0
    p[:, i] = 0.0
    p[i, i] = variance
