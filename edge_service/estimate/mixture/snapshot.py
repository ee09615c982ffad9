"""The bank of hypotheses as JSON-able values, bit for bit."""

from typing import Any

import numpy as np

from ...messages.arrays import decoded, encoded
from . import state
from .state import Bank

_LAYOUT = {
    name: value for name, value in vars(state).items() if name.isupper() and isinstance(value, int)
}
"""Meaning of each index of the state: another layout is another state."""


def bank_snapshot(bank: Bank) -> dict[str, Any]:
    """Every array as text."""
    arrays = {name: encoded(array) for name, array in bank._asdict().items()}
    return {"layout": dict(_LAYOUT), "size": bank.mean.shape[1], "arrays": arrays}


def restored_bank(snapshot: dict[str, Any], like: Bank) -> Bank:
    """The bank of a snapshot.

    Raises:
        ValueError: of another axis or version, or damaged.
    """
    size = like.mean.shape[1]
    if snapshot.get("layout") != _LAYOUT or snapshot.get("size") != size:
        found = snapshot.get("size")
        raise ValueError(f"the snapshot is of another axis or version: {found} states, not {size}")
    arrays = snapshot["arrays"]
    kept = {}
    for name, array in like._asdict().items():
        values = decoded(arrays[name], array.dtype)
        if values.size != array.size:
            raise ValueError(f"a damaged snapshot: {values.size} values of {name}")
        kept[name] = values.reshape(array.shape).copy()
    bank = Bank(**kept)
    _check(bank)
    return bank


def _check(bank: Bank) -> None:
    alive = bank.alive
    if not np.isin(alive, (0, 1)).all() or not alive.any():
        raise ValueError("a damaged snapshot: no hypothesis is left")
    rows = alive > 0
    numbers = (bank.log_weight[rows], bank.mean[rows], bank.covariance[rows], bank.age_s[rows])
    whole = (bank.force, bank.force_n, bank.moments)
    if not all(np.isfinite(array).all() for array in (*numbers, *whole)):
        raise ValueError("a damaged snapshot: it contains values that are not finite")
    if not np.isin(bank.directions, (0, 1, 2, 3)).all():
        raise ValueError("a damaged snapshot: a hypothesis without directions")
