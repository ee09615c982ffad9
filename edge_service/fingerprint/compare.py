"""Changes between fingerprints of one axis, and between the moves that its recordings repeat.

Opposite directions of one move tell friction from a load: friction turns its sign with the
direction, gravity and a load do not. So torque, following error and stretch are each split into
half their difference and half their sum. A recording's mean has the error of its repeats, of which
neighbours depend on each other, and an error from one day to the next that no repeats show
(`REPEATABILITY`). Every interval is as wide as all together need to hold with the stated level
(Bonferroni), so of the comparisons of a healthy axis one in twenty names a change.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from ..messages.samples import Floats
from ..messages.stored import finite_or_none
from ..regression.interval_estimate import LEVEL, IntervalEstimate, around, normal_quantile
from ..regression.linear import effective_size
from .moves import (
    FOLLOWING_M,
    SPREAD_NM,
    STRETCH_M,
    TEMPERATURE_C,
    TORQUE_NM,
    Move,
    Section,
    common_sections,
)
from .result import AxisFingerprint, Status

FALSE_DISCOVERY_RATE = 0.01
"""Expected share of false ones among the changes called significant."""
MATERIAL_SHARE = 0.05
"""A change of less than this share of the old value is no matter for maintenance."""
LEAST_MATERIAL: Mapping[str, float] = {"N m": 0.005, "m": 1e-6, "Hz": 1.0, "s": 1e-4, "1": 0.02}
"""Nor is one of less than this, by unit: what no repetition of a test on a machine comes below."""
REPEATABILITY = 0.01
"""Assumption: relative scatter of a figure from one mounting of a test to the next."""
_DAILY_M = 0.5 * LEAST_MATERIAL["m"]
"""Error of a stretch from one recording to the next, one sigma."""
_HEAT_C = 2.0
"""Friction may follow a change of temperature by more than this."""


@dataclass(frozen=True, slots=True)
class FigureChange:
    name: str  # `section.figure`
    old: IntervalEstimate
    new: IntervalEstimate
    change: IntervalEstimate  # now less then, with its interval
    sigmas: float  # the change in standard deviations
    significant: bool  # after controlling the false-discovery rate over all figures
    material: bool  # great enough to matter

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
            # of each interval the side that faces the other counts
            difference = now.value - was.value
            towards = (was.value - was.low, now.high - now.value)
            if difference > 0.0:
                towards = (was.high - was.value, now.value - now.low)
            repeated = REPEATABILITY * math.hypot(was.value, now.value)
            sigma = math.hypot(math.hypot(*towards) / normal_quantile(), repeated)
            change = around(difference, sigma, now.unit, math.inf)
            changes.append(change)
    sigmas = [each.value / each.sigma if each.sigma > 0.0 else 0.0 for each in changes]
    found = np.zeros(0, dtype=bool)
    if sigmas:
        chances = 2.0 * stats.norm.sf(np.abs(np.array(sigmas)))
        found = stats.false_discovery_control(chances) <= FALSE_DISCOVERY_RATE
    compared = []
    for k, (name, was, now) in enumerate(pairs):
        least = max(MATERIAL_SHARE * abs(was.value), LEAST_MATERIAL.get(changes[k].unit, 0.0))
        seen = bool(found[k]), abs(changes[k].value) >= least
        compared.append(FigureChange(name, was, now, changes[k], sigmas[k], *seen))
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


@dataclass(frozen=True, slots=True)
class Reading:
    """Mean of one quantity in one recording."""

    value: float
    sigma: float  # standard deviation of its error, from the repeats
    freedom: float  # degrees of freedom behind sigma
    daily: float  # standard deviation of an error from one recording to the next


@dataclass(frozen=True, slots=True)
class Drift:
    """One quantity of a section over all recordings.

    Attributes:
        since: number of the recording from which on it is changed; None if it is not at the end.
    """

    name: str  # `friction_nm`, `load_nm`, ...
    values: tuple[float, ...]  # of each recording
    changes: tuple[IntervalEstimate, ...]  # of each recording but the first, against the first

    @property
    def changed(self) -> tuple[bool, ...]:
        """Flag of each change: True if it is beyond the scatter."""
        return tuple(change.low > 0.0 or change.high < 0.0 for change in self.changes)

    @property
    def since(self) -> int | None:
        """Number of the recording from which on it differs from the first; None if it does not."""
        if not self.changed[-1]:
            return None
        first = len(self.changed) - 1
        while first > 0 and self.changed[first - 1]:
            first -= 1
        return first + 1

    @property
    def relative(self) -> float:
        """Change at the end as a share of the first value; NaN where that is zero."""
        return self.changes[-1].value / abs(self.values[0]) if self.values[0] else math.nan


@dataclass(frozen=True, slots=True)
class SectionDrift:
    section: Section
    drifts: tuple[Drift, ...]
    temperature_c: tuple[float, ...]  # mean of each recording; NaN where it is not recorded

    @property
    def heat(self) -> float:
        """Change of the temperature at the end, K; NaN where it is not recorded."""
        return self.temperature_c[-1] - self.temperature_c[0]

    @property
    def may_be_heat(self) -> bool:
        """Difference of temperature so great that friction may follow it."""
        return abs(self.heat) > _HEAT_C


def compare_moves(recordings: Sequence[Sequence[Move]]) -> tuple[SectionDrift, ...]:
    """Every common section of two recordings or more, each against the first recording."""
    readings = [(each, _readings(each)) for each in common_sections(recordings)]
    comparisons = sum(len(found) for _, found in readings) * (len(recordings) - 1)
    sections = []
    for section, found in readings:
        drifts = []
        for name, (first, *later) in found.items():
            changes = tuple(_change_of_mean(first, each, name, comparisons) for each in later)
            drifts.append(Drift(name, tuple(each.value for each in (first, *later)), changes))
        warmth = []
        for moves in section.there:
            known = [m.figures[TEMPERATURE_C] for m in moves if TEMPERATURE_C in m.figures]
            warmth.append(float(np.mean(known)) if known else math.nan)
        sections.append(SectionDrift(section, tuple(drifts), tuple(warmth)))
    return tuple(sections)


def _readings(section: Section) -> dict[str, list[Reading]]:
    """Quantities that every recording has, with a reading for each."""
    found: dict[str, list[Reading]] = {}
    pairs = zip(section.there, section.back or section.there, strict=True)
    for there, back in pairs:
        for name, reading in _of_recording(there, back if section.both_ways else ()).items():
            found.setdefault(name, []).append(reading)
    return {name: each for name, each in found.items() if len(each) == len(section.there)}


_SPLIT = {
    TORQUE_NM: ("friction_nm", "load_nm"),
    FOLLOWING_M: ("lag_m", "offset_m"),
    STRETCH_M: ("lost_motion_m", "stretch_m"),
}
"""Figure of a move -> its part that turns with the direction, and the one that does not."""


def _of_recording(there: Sequence[Move], back: Sequence[Move]) -> dict[str, Reading]:
    found: dict[str, Reading] = {}
    sign = math.copysign(1.0, there[0].speed_m_s)
    for name in (TORQUE_NM, FOLLOWING_M, STRETCH_M, SPREAD_NM):
        if not all(name in move.figures for move in (*there, *back)):
            continue
        one = _reading(there, name)
        if not back:
            found[name] = one
            continue
        other = _reading(back, name)
        if name == SPREAD_NM:
            found[name] = _half(one, other, 1.0)
            continue
        turning, standing = _SPLIT[name]
        found[turning] = _half(one, other, -1.0, sign)
        found[standing] = _half(one, other, 1.0)
    return found


def _reading(moves: Sequence[Move], name: str) -> Reading:
    values: Floats = np.array([move.figures[name] for move in moves])
    independent = min(max(effective_size(values), 2.0), float(values.size))
    sigma = float(values.std(ddof=1)) / math.sqrt(independent)
    size = float(np.abs(values).mean())
    daily = _DAILY_M if name == STRETCH_M else REPEATABILITY * size  # a stretch has no zero
    return Reading(float(values.mean()), sigma, independent - 1.0, daily)


def _half(one: Reading, other: Reading, part: float, sign: float = 1.0) -> Reading:
    """Half the sum, or with a part of -1 half the difference, with a sign."""
    return Reading(
        0.5 * sign * (one.value + part * other.value),
        0.5 * math.hypot(one.sigma, other.sigma),
        _welch((one, other)),
        0.5 * (one.daily + other.daily),
    )


def _welch(readings: Sequence[Reading]) -> float:
    """Degrees of freedom of a sum (Welch and Satterthwaite)."""
    variances = [each.sigma**2 for each in readings]
    parts = [v**2 / each.freedom for v, each in zip(variances, readings, strict=True)]
    return sum(variances) ** 2 / sum(parts) if sum(parts) > 0.0 else readings[0].freedom


def _change_of_mean(old: Reading, new: Reading, name: str, comparisons: int) -> IntervalEstimate:
    share = 0.5 * (1.0 - LEVEL) / comparisons
    freedom = _welch((old, new))
    repeats = float(stats.t.isf(share, freedom)) * math.hypot(old.sigma, new.sigma)
    from_day_to_day = float(stats.norm.isf(share)) * math.hypot(old.daily, new.daily)
    half = math.hypot(repeats, from_day_to_day)
    change, unit = new.value - old.value, "N m" if name.endswith("_nm") else "m"
    return IntervalEstimate(change, change - half, change + half, unit, freedom + 1.0)
