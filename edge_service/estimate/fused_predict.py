"""How a hypothesis of the fused estimator drifts between two phases.

Covariances are symmetric to the last bit: whole rows are written, then mirrored. The functions run
compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math

from ..messages.samples import Floats
from ..models.compiled import compiled
from .fused_state import (
    BEGUN,
    DRY,
    ENDED,
    GAP,
    GAP_RATE,
    GROWTH,
    GROWTH_RATE,
    GUIDE,
    PRELOAD,
    QUIET,
    RATE,
    SETTLING,
    SLIDE,
    STATES,
    VISCOUS,
    WEARING,
    Drift,
    FusedModel,
    Mixture,
    Reading,
)

_SETTLING_S = 15.0
_WARMING_S = 300.0
_SETTLING_HASTE = 8.0
_SETTLED_S = 4.0


@compiled
def predict_state(
    mixture: Mixture, k: int, model: FusedModel, drift: Drift, elapsed_s: float, r: Reading
) -> None:
    """Let a hypothesis drift over `elapsed_s`, in which the axis moved as in `r`."""
    moved_s = r.steady_s
    x, p = mixture.mean[k], mixture.covariance[k]
    mixture.age_s[k] += moved_s
    if mixture.mode[k] == SETTLING and mixture.age_s[k] > _SETTLING_S:
        mixture.mode[k] = QUIET
    haste = 1.0
    if mixture.mode[k] == SETTLING:
        haste += _SETTLING_HASTE * math.exp(-mixture.age_s[k] / _SETTLED_S)
    _spread(p, drift.uneven, elapsed_s)
    for i in range(STATES):
        time_s = moved_s if drift.moving[i] else elapsed_s
        walk = drift.walk[i]
        if i in (DRY, GUIDE, VISCOUS, SLIDE):
            walk *= haste
        p[i, i] += walk * walk * time_s
    lasting = math.exp(-elapsed_s / _WARMING_S)
    _run(x, p, GAP, GAP_RATE, _WARMING_S * (1.0 - lasting), lasting)
    _run(x, p, GROWTH, GROWTH_RATE, _WARMING_S * (1.0 - lasting), lasting)
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, r.follows)
    if mixture.mode[k] == WEARING:
        _run(x, p, PRELOAD, RATE, moved_s, 1.0)
        p[RATE, RATE] += drift.rate_walk**2 * moved_s


@compiled
def _spread(p: Floats, uneven: Floats, elapsed_s: float) -> None:
    """Let the nodes along the stroke drift."""
    for i in range(uneven.shape[0]):
        for j in range(uneven.shape[0]):
            p[STATES + i, STATES + j] += elapsed_s * uneven[i, j]


@compiled
def _mirror(p: Floats, i: int) -> None:
    """A covariance is as its rows are: along them memory is fast."""
    for j in range(p.shape[0]):
        p[j, i] = p[i, j]


@compiled
def _pass_on(x: Floats, p: Floats, edge_rad2_s2: float, follows: bool) -> None:
    """Begin a phase with the speed's error at the end of the one before, or with a new one."""
    x[BEGUN] = x[ENDED] if follows else 0.0
    for j in range(x.shape[0]):
        p[BEGUN, j] = p[ENDED, j] if follows else 0.0
        p[ENDED, j] = 0.0
    p[BEGUN, BEGUN] = p[BEGUN, ENDED] if follows else edge_rad2_s2
    p[BEGUN, ENDED] = 0.0
    _mirror(p, BEGUN)
    x[ENDED] = 0.0
    p[ENDED, ENDED] = edge_rad2_s2
    _mirror(p, ENDED)


@compiled
def _run(x: Floats, p: Floats, i: int, rate: int, time_s: float, lasting: float) -> None:
    """Let x[i] run at x[rate] for a time, after which a share of the rate is left."""
    x[i] += x[rate] * time_s
    for j in range(x.shape[0]):
        p[i, j] += time_s * p[rate, j]
    p[i, i] += time_s * p[i, rate]
    _mirror(p, i)
    if lasting != 1.0:
        x[rate] *= lasting
        for j in range(x.shape[0]):
            p[rate, j] *= lasting
        p[rate, rate] *= lasting
        _mirror(p, rate)
