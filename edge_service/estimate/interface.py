"""Interface common to all preload estimators."""

from typing import Any, Protocol

from ..messages.estimate import PreloadEstimate
from ..messages.features import FeatureBlock


class PreloadEstimator(Protocol):
    """Features in, estimates out; no clock, no I/O, no randomness.

    The same blocks in the same order give bit-equal estimates, live or replayed.
    """

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""

    def estimate(self) -> PreloadEstimate:
        """Current estimate."""

    def interrupt(self) -> None:
        """Nothing was heard for longer than a number may stand: none stands until motion comes."""

    def resume(self, stopped_s: float) -> None:
        """Go on after a stop that nobody saw, on a clock of its own.

        The axis has cooled and may have worked or worn meanwhile; it may even be another.
        """

    def reset(self) -> None:
        """Forget everything."""

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values; `restore` of it goes on bit-equal."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot. ValueError if it is none of this estimator's."""
