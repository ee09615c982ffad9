"""Doubt of a best explanation that is none: how much it leaves, and what it had to bend for it."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ..candidates.design_matrix import DesignMatrix
from ..selection.problem import Fit
from ..session.session import Session

UNKNOWN_SHARE = 0.15
"""Share of the gap's energy above the floor; with more left over, the named effects are doubted."""
UNKNOWN_ENTRY_SHARE = 0.6
"""The same of what the entries alone leave, without the forms that an effect takes beside them."""
MOST_CAUSES = 3
"""It takes more than this many causes at once only where none of them is the true one."""
MOST_STRETCH = 6.0
"""Tolerances by which a parameter that is not named may be off."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Doubt about the causes in one channel: `confidence` scales their probabilities."""

    is_unknown: bool
    confidence: float


def doubts_of(
    session: Session, left: Mapping[str, float], left_by_entries: Mapping[str, float], causes: int
) -> dict[str, Doubt]:
    """Doubt in each channel.

    Args:
        left: share that the best fit with empirical shapes leaves.
        left_by_entries: share that the entries of the library leave alone, where they claim any.
        causes: how many are named.
    """
    doubts = {}
    for name in session.channels:
        is_unknown = left[name] > UNKNOWN_SHARE or causes > MOST_CAUSES
        is_unknown |= left_by_entries.get(name, 0.0) > UNKNOWN_ENTRY_SHARE
        confidence = 0.5 * (1.0 - left[name]) if is_unknown else 1.0
        doubts[name] = Doubt(is_unknown, confidence)
    return doubts


def is_stretched(
    design: DesignMatrix, best: Fit, parameters: Collection[str], named: Collection[str]
) -> bool:
    """Tell whether a parameter that is not named has to leave its tolerance for the fit."""
    for k in range(design.nuisances):
        name = design.regressors[k].name
        if name in parameters and name not in named:
            place = int(design.first[k])
            off = best.coefficients[place] - design.mean[place]
            if abs(float(off)) * float(np.sqrt(design.precision[place])) > MOST_STRETCH:
                return True
    return False
