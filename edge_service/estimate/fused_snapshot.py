"""The hypotheses of the fused estimator as JSON-able values, bit for bit."""

from typing import Any

import numpy as np

from ..messages.array_text import decoded, encoded
from . import fused_state
from .fused_state import CAPACITY, Mixture

_LAYOUT = {
    name: value
    for name, value in vars(fused_state).items()
    if name.isupper() and isinstance(value, int)
}
"""What an index of the state means: another layout is another state."""
_WHOLE = ("alive", "since_force_s")


def mixture_snapshot(mixture: Mixture) -> dict[str, Any]:
    """The rows that count."""
    rows = int(mixture.alive[0])
    arrays = {
        name: array if name in _WHOLE else array[:rows] for name, array in mixture._asdict().items()
    }
    told = {name: encoded(array) for name, array in arrays.items()}
    return {"layout": dict(_LAYOUT), "size": mixture.mean.shape[1], "arrays": told}


def restored_mixture(snapshot: dict[str, Any], like: Mixture) -> Mixture:
    """The mixture of a snapshot.

    Raises:
        ValueError: of another axis or version, or damaged.
    """
    size = like.mean.shape[1]
    if snapshot.get("layout") != _LAYOUT or snapshot.get("size") != size:
        told_size = snapshot.get("size")
        raise ValueError(f"a snapshot of another axis or version: {told_size} states, not {size}")
    told = snapshot["arrays"]
    kept = {name: decoded(told[name], array.dtype) for name, array in like._asdict().items()}
    rows = int(kept["alive"][0]) if kept["alive"].size == 1 else 0
    if not 1 <= rows <= CAPACITY:
        raise ValueError(f"a damaged snapshot: {rows} hypotheses, expected 1 to {CAPACITY}")
    mixture = like._replace(
        **{name: np.zeros_like(array) for name, array in like._asdict().items()}
    )
    mixture.log_weight[:] = -np.inf
    for name, array in mixture._asdict().items():
        part = array if name in _WHOLE else array[:rows]
        part[...] = kept[name].reshape(part.shape)
    _check(mixture, rows)
    return mixture


def _check(mixture: Mixture, rows: int) -> None:
    numbers = (mixture.log_weight, mixture.force, mixture.mean, mixture.covariance)
    if not all(np.isfinite(array[:rows]).all() for array in numbers):
        raise ValueError("a damaged snapshot: it holds what is not finite")
    modes = (fused_state.QUIET, fused_state.WEARING, fused_state.SETTLING)
    if np.isnan(mixture.age_s[:rows]).any() or not np.isin(mixture.mode[:rows], modes).all():
        raise ValueError("a damaged snapshot: a hypothesis without age or mode")
