"""Interface common to all preload estimators."""

from typing import Any, Literal, Protocol

from ..messages.estimate import PreloadEstimate
from ..messages.features import FeatureBlock


class UnsuitableMachineError(Exception):
    """Lack of the machine file that an estimator cannot do without; the text names it."""


class EstimatorOptions(Protocol):
    """Choices of the user, `[estimator]`; an estimator heeds those that concern it."""

    @property
    def engine(self) -> Literal["compiled", "filterpy"]:
        """Engine of the filter bank."""


class PreloadEstimator(Protocol):
    """Features in, estimates out; no clock, no I/O, no randomness.

    The same blocks in the same order give bit-equal estimates, live or replayed.
    """

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""

    def estimate(self) -> PreloadEstimate:
        """Current estimate."""

    def interrupt(self) -> None:
        """Withdraw the number until motion comes: no data for longer than a number may stand."""

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own.

        The axis has cooled and may have worked or worn meanwhile; it may even be another.
        """

    def reset(self) -> None:
        """Forget everything."""

    def snapshot(self) -> dict[str, Any]:
        """Whole state as JSON-able values; `restore` of it continues bit-equal."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot. ValueError if it is not of this estimator."""
