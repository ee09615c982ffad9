"""Hypotheses are born, weighed, dropped and merged."""

import math

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats
from ..models.compiled import compiled
from .fused_state import (
    CROWD,
    DRY,
    GUIDE,
    MASS,
    PRELOAD,
    Drift,
    Mixture,
)

_LEAST_LOG_WEIGHT = -13.0
_LEAST_BEGUN_LOG_WEIGHT = -25.0
_LEAST_PERCENT = 0.02
_MERGE_DISTANCE = 0.25


@compiled
def spawn_jumps(
    mixture: Mixture,
    parent: int,
    drift: Drift,
    motion_s: float,
    driven: bool,
    drifted: npt.NDArray[np.bool_],
) -> None:
    """Children of a hypothesis, one for each kind of jump; the least likely make room.

    Where a force seems to drive the axis (`driven`), only loads and losses are looked for. Children
    have drifted as their parent, which is noted in `drifted` (CAPACITY,).
    """
    for j in range(drift.hazards.shape[0]):
        if driven and drift.jumps[j, MASS, MASS] == 0.0 and drift.shifts[j, PRELOAD] == 0.0:
            continue
        log_weight = mixture.log_weight[parent] + math.log(max(drift.hazards[j] * motion_s, 1e-300))
        k = mixture.alive[0]
        if k >= CROWD:
            k = int(np.argmin(mixture.log_weight[:k]))
            if k == parent or mixture.log_weight[k] >= log_weight:
                continue
        else:
            mixture.alive[0] += 1
        drifted[k] = True
        mixture.log_weight[k] = log_weight
        mixture.mode[k] = drift.modes[j]
        mixture.kind[k] = j
        mixture.age_s[k] = 0.0
        mixture.force[k] = 0.0
        mixture.mean[k] = mixture.mean[parent] + drift.shifts[j]
        if drift.shifts[j, PRELOAD] < 0.0:
            mixture.mean[k, PRELOAD] = max(mixture.mean[k, PRELOAD], _LEAST_PERCENT)
        _add(mixture.covariance[parent], drift.jumps[j], mixture.covariance[k])


@compiled
def _add(first: Floats, second: Floats, total: Floats) -> None:
    for i in range(first.shape[0]):
        for j in range(first.shape[0]):
            total[i, j] = first[i, j] + second[i, j]


@compiled
def leader_of(mixture: Mixture) -> int:
    return int(np.argmax(mixture.log_weight[: mixture.alive[0]]))


@compiled
def tidy(mixture: Mixture) -> None:
    """Scale the weights to 1, drop the hopeless, merge those that have become alike."""
    count = mixture.alive[0]
    top = mixture.log_weight[:count].max()
    total = 0.0
    for k in range(count):
        total += math.exp(mixture.log_weight[k] - top)
    shift = top + math.log(total)
    kept = 0
    for k in range(count):
        mixture.log_weight[k] -= shift
        least = _LEAST_BEGUN_LOG_WEIGHT if mixture.kind[k] < 0 else _LEAST_LOG_WEIGHT
        if mixture.log_weight[k] < least:
            continue
        _move(mixture, k, kept)
        kept += 1
    mixture.alive[0] = kept
    mixture.log_weight[kept:] = -math.inf
    k = 0
    while k < mixture.alive[0]:
        j = k + 1
        while j < mixture.alive[0]:
            if mixture.mode[k] == mixture.mode[j] and _alike(mixture, k, j):
                _merge(mixture, k, j)
            else:
                j += 1
        k += 1


@compiled
def _move(mixture: Mixture, source: int, target: int) -> None:
    if source != target:
        mixture.log_weight[target] = mixture.log_weight[source]
        mixture.mode[target] = mixture.mode[source]
        mixture.kind[target] = mixture.kind[source]
        mixture.age_s[target] = mixture.age_s[source]
        mixture.force[target] = mixture.force[source]
        mixture.mean[target] = mixture.mean[source]
        mixture.covariance[target] = mixture.covariance[source]


@compiled
def _alike(mixture: Mixture, k: int, j: int) -> bool:
    for i in (PRELOAD, DRY, GUIDE, MASS):
        vk, vj = mixture.covariance[k, i, i], mixture.covariance[j, i, i]
        least, most = min(vk, vj), max(vk, vj)
        away = mixture.mean[k, i] - mixture.mean[j, i]
        if away * away > _MERGE_DISTANCE * least or most > 1.5 * least:
            return False
    return True


@compiled
def _merge(mixture: Mixture, k: int, j: int) -> None:
    """Moment-match j into k and close the row."""
    wk, wj = math.exp(mixture.log_weight[k]), math.exp(mixture.log_weight[j])
    share = wj / (wk + wj)
    away = mixture.mean[j] - mixture.mean[k]
    mixture.mean[k] += share * away
    one, other = mixture.covariance[k], mixture.covariance[j]
    for m in range(away.shape[0]):
        far = away[m]
        for n in range(away.shape[0]):
            apart = (1.0 - share) * (far * away[n])
            one[m, n] += share * (other[m, n] - one[m, n] + apart)
    mixture.log_weight[k] = math.log(wk + wj)
    last = mixture.alive[0] - 1
    _move(mixture, last, j)
    mixture.log_weight[last] = -math.inf
    mixture.alive[0] = last
