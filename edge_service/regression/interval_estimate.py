"""Result of identifying one quantity: value, interval, and the reason if undetermined."""

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer
from scipy import special

from ..messages.stored import finite_or_none

_NULL = PlainSerializer(finite_or_none)
_Value = Annotated[float, BeforeValidator(lambda v: math.nan if v is None else v), _NULL]
_Low = Annotated[float, BeforeValidator(lambda v: -math.inf if v is None else v), _NULL]
_High = Annotated[float, BeforeValidator(lambda v: math.inf if v is None else v), _NULL]

LEVEL = 0.95
"""Probability with which [low, high] aims to hold the truth."""


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """One identified quantity; in a document null stands for what is not finite."""

    value: _Value  # the estimate; NaN where the data says nothing
    # low, high: bounds that hold the truth with probability `LEVEL`; infinite where the data sets
    # none
    low: _Low
    high: _High
    unit: str  # of the three
    # independent observations behind it; a correlated residual has fewer than rows
    n_effective: _High
    note: str = ""  # why it is undetermined, or what to keep in mind

    @property
    def determined(self) -> bool:
        """Flag of an interval with two finite bounds."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    @property
    def sigma(self) -> float:
        """Standard deviation of a normal distribution with the same interval; may be infinite."""
        return (self.high - self.low) / (2.0 * normal_quantile())

    def holds(self, truth: float) -> bool:
        """Flag of an interval that contains `truth`."""
        return self.low <= truth <= self.high

    def scaled(self, factor: float, unit: str) -> "IntervalEstimate":
        """The quantity times `factor` (not 0), in another unit."""
        low, high = sorted((self.low * factor, self.high * factor))
        return IntervalEstimate(self.value * factor, low, high, unit, self.n_effective, self.note)


def normal_quantile() -> float:
    """Half width of the interval of a normal distribution in standard deviations, 1.96."""
    return float(special.ndtri(0.5 + 0.5 * LEVEL))


def student_quantile(freedom: float) -> float:
    """Half width of the interval in estimated standard deviations, Student's t; may be infinite."""
    return float(special.stdtrit(freedom, 0.5 + 0.5 * LEVEL)) if freedom >= 1.0 else math.inf


def around(
    value: float, sigma: float, unit: str, n_effective: float, parameters: int = 1, note: str = ""
) -> IntervalEstimate:
    """An estimate with a symmetric interval from its standard deviation.

    >>> round(around(2.0, 0.5, "N m", 1e9).high, 4)
    2.98
    """
    half = student_quantile(n_effective - parameters) * sigma
    if not math.isfinite(half):
        return undetermined(unit, note or "too few independent observations", n_effective)
    return IntervalEstimate(value, value - half, value + half, unit, n_effective, note)


def undetermined(unit: str, note: str, n_effective: float = 0.0) -> IntervalEstimate:
    """A quantity that the data says nothing about."""
    return IntervalEstimate(math.nan, -math.inf, math.inf, unit, n_effective, note)
