"""How a hypothesis of the fused estimator drifts between two phases.

Covariances are symmetric to the last bit: whole rows are written, then mirrored. The functions run
compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

import numpy as np

from ..messages.samples import Floats
from ..models.compiled import compiled, inlined
from .fused_state import (
    BEGUN,
    DRY,
    ENDED,
    GAP,
    GAP_RATE,
    GROWTH,
    GROWTH_RATE,
    GUIDE,
    LUBE,
    PRELOAD,
    QUIET,
    RATE,
    RUB_NODES,
    SETTLING,
    SLIDE,
    STATES,
    VISCOUS,
    WEARING,
    Drift,
    FusedModel,
    Mixture,
)

_SETTLING_S = 15.0
_WARMING_S = 300.0
_SETTLING_HASTE = 8.0
_SETTLED_S = 4.0


class Step(NamedTuple):
    """What a phase adds to every hypothesis alike."""

    walk: Floats  # (STATES,), variance of what wanders
    elapsed_s: float
    moved_s: float
    lasting: float  # share of a rate of growth that is left after it


@compiled
def step_of(drift: Drift, elapsed_s: float, moved_s: float) -> Step:
    """A step of `elapsed_s`, in which the axis moved for `moved_s`."""
    walk = np.empty(STATES)
    for i in range(STATES):
        time_s = moved_s if drift.moving[i] else elapsed_s
        walk[i] = drift.walk[i] * drift.walk[i] * time_s
    return Step(walk, elapsed_s, moved_s, math.exp(-elapsed_s / _WARMING_S))


@inlined
def predict_state(
    mixture: Mixture, k: int, model: FusedModel, drift: Drift, step: Step, follows: bool
) -> None:
    """Let a hypothesis drift over a step; `follows` as in Reading."""
    x, p = mixture.mean[k], mixture.covariance[k]
    mixture.age_s[k] += step.moved_s
    if mixture.mode[k] == SETTLING and mixture.age_s[k] > _SETTLING_S:
        mixture.mode[k] = QUIET
    for i in range(STATES):
        p[i, i] += step.walk[i]
    if mixture.mode[k] == SETTLING:
        haste = 1.0 + _SETTLING_HASTE * math.exp(-mixture.age_s[k] / _SETTLED_S)
        for i in (DRY, GUIDE, VISCOUS, SLIDE, LUBE):
            p[i, i] += (haste * haste - 1.0) * step.walk[i]
    _spread(p, drift.uneven, step.elapsed_s)
    _grow(x, p, step.lasting)
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, follows)
    _mirror(p)
    if mixture.mode[k] == WEARING:
        _wear(x, p, step.moved_s)
        p[RATE, RATE] += drift.rate_walk**2 * step.moved_s


@inlined
def _spread(p: Floats, uneven: Floats, elapsed_s: float) -> None:
    """Let the nodes along the stroke drift: growth with growth, friction with friction."""
    size = uneven.shape[0]
    edge = size - RUB_NODES
    for i in range(size):
        for j in range(edge) if i < edge else range(edge, size):
            p[STATES + i, STATES + j] += elapsed_s * uneven[i, j]


@inlined
def _grow(x: Floats, p: Floats, lasting: float) -> None:
    """Let the gap and the growth run at their rates; only rows of `p` are written."""
    time_s = _WARMING_S * (1.0 - lasting)
    x[GAP] += x[GAP_RATE] * time_s
    x[GROWTH] += x[GROWTH_RATE] * time_s
    x[GAP_RATE] *= lasting
    x[GROWTH_RATE] *= lasting
    for j in range(x.shape[0]):
        p[GAP, j] += time_s * p[GAP_RATE, j]
        p[GAP_RATE, j] *= lasting
    for j in range(x.shape[0]):
        p[GROWTH, j] += time_s * p[GROWTH_RATE, j]
        p[GROWTH_RATE, j] *= lasting
    for i in (GAP, GROWTH, GAP_RATE, GROWTH_RATE):
        p[i, GAP] += time_s * p[i, GAP_RATE]
        p[i, GROWTH] += time_s * p[i, GROWTH_RATE]
        p[i, GAP_RATE] *= lasting
        p[i, GROWTH_RATE] *= lasting


@inlined
def _pass_on(x: Floats, p: Floats, edge_rad2_s2: float, follows: bool) -> None:
    """Begin a phase with the speed's error at the end of the one before, or with a new one.

    Only rows of `p` are written.
    """
    x[BEGUN] = x[ENDED] if follows else 0.0
    x[ENDED] = 0.0
    for j in range(x.shape[0]):
        p[BEGUN, j] = p[ENDED, j] if follows else 0.0
        p[ENDED, j] = 0.0
    p[BEGUN, BEGUN] = p[BEGUN, ENDED] if follows else edge_rad2_s2
    p[BEGUN, ENDED] = 0.0
    p[ENDED, ENDED] = edge_rad2_s2
    for i in (GAP, GROWTH, GAP_RATE, GROWTH_RATE):
        p[i, BEGUN] = p[BEGUN, i]
        p[i, ENDED] = 0.0


@inlined
def _mirror(p: Floats) -> None:
    """A covariance is as its rows are: along them memory is fast."""
    for j in range(p.shape[0]):
        p[j, GAP] = p[GAP, j]
        p[j, GROWTH] = p[GROWTH, j]
        p[j, GAP_RATE] = p[GAP_RATE, j]
        p[j, GROWTH_RATE] = p[GROWTH_RATE, j]
        p[j, BEGUN] = p[BEGUN, j]
        p[j, ENDED] = p[ENDED, j]


@inlined
def _wear(x: Floats, p: Floats, time_s: float) -> None:
    """Let the preload run at its rate."""
    x[PRELOAD] += x[RATE] * time_s
    for j in range(x.shape[0]):
        p[PRELOAD, j] += time_s * p[RATE, j]
    p[PRELOAD, PRELOAD] += time_s * p[PRELOAD, RATE]
    for j in range(x.shape[0]):
        p[j, PRELOAD] = p[PRELOAD, j]
