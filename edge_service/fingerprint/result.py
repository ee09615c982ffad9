"""One test of an axis: figures with intervals and curves, or why there are none."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ..messages.samples import Floats
from ..regression.interval_estimate import IntervalEstimate, normal_quantile, student_quantile

SPEED_DIGITS = 2
"""Speeds that agree in so many digits are one speed."""


class Status(StrEnum):
    """Status of a section: determined by the recordings or not."""

    DETERMINED = "determined"
    UNDETERMINED = "undetermined"


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A measured curve.

    Attributes:
        x, y: (n,) each, in SI units.
        x_label, y_label: quantity and unit.
    """

    name: str
    x: Floats
    y: Floats
    x_label: str
    y_label: str


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One test of the axis.

    Attributes:
        reason: why it is undetermined, one line; empty otherwise.
        motion: name of the motion that determines it.
        figures: by name, the unit in the name.
    """

    status: Status
    reason: str
    motion: str
    figures: Mapping[str, IntervalEstimate] = field(default_factory=dict)
    curves: tuple[Curve, ...] = ()


Contents = tuple[Mapping[str, IntervalEstimate], Sequence[Curve]]
"""Figures and curves of a section."""


def examined(motion: str, measure: Callable[[], Contents]) -> Section:
    """The section that `measure` gives; undetermined for its ValueError, or without a number."""
    try:
        figures, curves = measure()
    except ValueError as error:
        return Section(Status.UNDETERMINED, " ".join(str(error).split()), motion)
    if not any(math.isfinite(figure.value) for figure in figures.values()):
        notes = sorted({figure.note for figure in figures.values() if figure.note})
        reason = "; ".join(notes) or "the recordings say nothing about it"
        return Section(Status.UNDETERMINED, reason, motion, figures, tuple(curves))
    return Section(Status.DETERMINED, "", motion, figures, tuple(curves))


def mean_of(
    values: Sequence[float], standard_errors: Sequence[float], unit: str
) -> IntervalEstimate:
    """Mean of repeats: the greater of their scatter and their own errors makes the interval.

    Args:
        values, standard_errors: (n,) each, n at least 1.
    """
    count = len(values)
    own = math.sqrt(sum(error**2 for error in standard_errors)) / count
    scatter = float(np.std(values, ddof=1)) / math.sqrt(count) if count > 1 else 0.0
    quantile = student_quantile(count - 1) if scatter > own else normal_quantile()
    value, half = float(np.mean(values)), quantile * max(own, scatter)
    return IntervalEstimate(value, value - half, value + half, unit, float(count))


def rounded_rpm(speed_rad_s: float) -> str:
    """Magnitude of a speed in turns per minute with `SPEED_DIGITS` digits, for a name.

    >>> rounded_rpm(-12.5664)
    '120'
    """
    rpm = abs(speed_rad_s) * 60.0 / (2.0 * math.pi)
    digits = SPEED_DIGITS - 1 - math.floor(math.log10(rpm))
    return f"{round(rpm, digits):g}"
