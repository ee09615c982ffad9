"""Queries about an axis along its stroke, to whoever knows its physics."""

from typing import Protocol

from ..messages.samples import Floats

StrokeBand = tuple[Floats, Floats, Floats]
"""Value, lower and upper bound of a quantity along the stroke, (n,) each."""


class StrokeModel(Protocol):
    """Preload and stiffness along the stroke for a mean preload with its bounds, percent."""

    @property
    def position_m(self) -> Floats:
        """Places along the stroke, m, (n,)."""
        ...

    @property
    def fresh_percent(self) -> float:
        """Mean preload when the axis was commissioned, percent."""
        ...

    @property
    def knows_stiffness(self) -> bool:
        """True if `stiffness` can be asked."""
        ...

    def preload(self, percent: float, low: float, high: float) -> StrokeBand:
        """Preload at every place, percent."""
        ...

    def stiffness(self, percent: float, low: float, high: float) -> StrokeBand:
        """Series stiffness between motor and table at every place, N/m."""
        ...
