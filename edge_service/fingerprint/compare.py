"""Changes between two fingerprints of one axis: their size, and whether they matter."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from ..messages.stored import finite_or_none
from ..regression.interval_estimate import IntervalEstimate, around, normal_quantile
from .result import AxisFingerprint, Status

FALSE_DISCOVERY_RATE = 0.01
"""Expected share of false ones among the changes called significant."""
MATERIAL_SHARE = 0.05
"""A change of less than this share of the old value is no matter for maintenance."""
LEAST_MATERIAL: Mapping[str, float] = {"N m": 0.005, "m": 1e-6, "Hz": 1.0, "s": 1e-4, "1": 0.02}
"""Nor is one of less than this, by unit: what no repetition of a test on a machine comes below."""
REPEATABILITY = 0.01
"""Assumption: relative scatter of a figure from one mounting of a test to the next."""


@dataclass(frozen=True, slots=True)
class FigureChange:
    """One figure then and now.

    Attributes:
        name: `section.figure`.
        change: now less then, with its interval.
        sigmas: the change in standard deviations.
        significant: after controlling the false-discovery rate over all figures.
        material: great enough to matter.
    """

    name: str
    old: IntervalEstimate
    new: IntervalEstimate
    change: IntervalEstimate
    sigmas: float
    significant: bool
    material: bool

    @property
    def changed(self) -> bool:
        """Significant and material."""
        return self.significant and self.material

    @property
    def relative(self) -> float:
        """Change as a share of the old value; NaN where that is zero."""
        return self.change.value / abs(self.old.value) if self.old.value else math.nan

    def document(self) -> dict[str, Any]:
        """Entry of `fingerprint.json`, in the unit of the figure."""
        return {
            "figure": self.name,
            "old": self.old.value,
            "new": self.new.value,
            "change": self.change.value,
            "low": self.change.low,
            "high": self.change.high,
            "unit": self.change.unit,
            "relative": finite_or_none(self.relative),
            "sigmas": self.sigmas,
            "significant": self.significant,
            "material": self.material,
        }


def compare_fingerprints(new: AxisFingerprint, old: AxisFingerprint) -> tuple[FigureChange, ...]:
    """Every figure that both know, in the order of the new one.

    Benjamini and Hochberg (1995) over all of them, with normal deviates.
    """
    before, pairs, changes = old.figures(), [], []
    for name, now in new.figures().items():
        was = before.get(name, now)
        known = all(math.isfinite(each.value) and each.determined for each in (was, now))
        if name in before and known and was.unit == now.unit:
            pairs.append((name, was, now))
            changes.append(_change(was, now))
    sigmas = [each.value / each.sigma if each.sigma > 0.0 else 0.0 for each in changes]
    found = np.zeros(0, dtype=bool)
    if sigmas:
        chances = 2.0 * stats.norm.sf(np.abs(np.array(sigmas)))
        found = stats.false_discovery_control(chances) <= FALSE_DISCOVERY_RATE
    compared = []
    for k, (name, was, now) in enumerate(pairs):
        least = max(MATERIAL_SHARE * abs(was.value), LEAST_MATERIAL.get(changes[k].unit, 0.0))
        material = abs(changes[k].value) >= least
        compared.append(
            FigureChange(name, was, now, changes[k], sigmas[k], bool(found[k]), material)
        )
    return tuple(compared)


def appeared_figures(new: AxisFingerprint, old: AxisFingerprint) -> tuple[str, ...]:
    """Figures that only the new one has, in sections that both determine.

    A friction that begins to rise at low speed is one: before, there was nothing to compare with.
    The preload is none, for its stiffness part needs a baseline to exist.
    """
    before = old.figures()
    return tuple(
        name
        for name, figure in new.figures().items()
        if name in before
        and not name.startswith("preload.")
        and figure.determined
        and math.isfinite(figure.value)
        and not before[name].determined
        and old.sections[name.partition(".")[0]].status is Status.DETERMINED
    )


def _change(old: IntervalEstimate, new: IntervalEstimate) -> IntervalEstimate:
    """Difference; of each interval the side that faces the other counts."""
    difference = new.value - old.value
    towards = (
        (old.high - old.value, new.value - new.low)
        if difference > 0.0
        else (old.value - old.low, new.high - new.value)
    )
    repeated = REPEATABILITY * math.hypot(old.value, new.value)
    sigma = math.hypot(math.hypot(*towards) / normal_quantile(), repeated)
    return around(difference, sigma, new.unit, math.inf)
