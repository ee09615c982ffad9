"""One axis of the estimate node: its estimator, fed live, kept, and gone on with."""

import json
import logging

from ...estimate.interface import PreloadEstimator
from ...messages.estimate import PreloadEstimate
from ...messages.features import FeatureBlock
from ...messages.header import Header
from .estimate_state import DAMAGED, Kept, StateError

log = logging.getLogger(__name__)
SILENCE_S = 10.0
"""Without features for this long, what was known before is of unknown age."""
SAME_CLOCK_S = 60.0
"""By so much the axis' clock may have lost of a stop and still be the one that ran before it."""
STOP_S = 600.0
"""In a longer stop that nobody saw, an axis may have become another."""


class EstimatedAxis:
    """Feeds an estimator; goes on from what was kept of it."""

    def __init__(self, axis: str, estimator: PreloadEstimator) -> None:
        self._axis = axis
        self._estimator = estimator
        self._heard: tuple[float, int] | None = None
        self._restored = False
        self._changed = False

    def take(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        """Take the next interval; what is known after it."""
        if self._heard is not None:
            self._bridge(*self._heard, header, block)
        self._heard = block.time_s, header.source_time_ns
        self._restored, self._changed = False, True
        self._estimator.update(block)
        return self._estimator.estimate()

    def _bridge(self, time_s: float, heard_ns: int, header: Header, block: FeatureBlock) -> None:
        silent_s = (header.source_time_ns - heard_ns) / 1e9
        if self._restored and not _goes_on(time_s, silent_s, block):
            log.info("axis %s: its estimate continues after a stop of %.0f s", self._axis, silent_s)
            self._estimator.resume(silent_s)
        elif silent_s > SILENCE_S:
            self._estimator.interrupt()

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns: nobody was silent meanwhile."""
        if self._heard is not None:
            self._heard = (self._heard[0], self._heard[1] + step_ns)

    def begin(self, estimator: PreloadEstimator, kept: Kept | None = None) -> None:
        """Begin with another estimator, from a state. Raises StateError if it is none."""
        self._estimator = estimator
        self._heard, self._restored, self._changed = None, False, False
        if kept is not None:
            self.restore(kept)

    def now(self) -> Kept | None:
        """The state as of now; None if nothing was taken in."""
        if self._heard is None:
            return None
        return Kept(*self._heard, self._estimator.snapshot())

    def restore(self, kept: Kept) -> None:
        """Go on from a state. Raises StateError if it is none, and begins anew then."""
        try:
            self._estimator.restore(kept.snapshot)
            self._estimator.estimate()  # numbers of the right shape may still mean nothing
            json.dumps(self._estimator.snapshot(), allow_nan=False)
        except DAMAGED as error:
            self._estimator.reset()
            raise StateError(
                f"it is not a state of this estimator ({error})", damaged=True
            ) from None
        self._heard, self._restored = (kept.time_s, kept.source_time_ns), True

    def to_keep(self) -> Kept | None:
        """The state, if something was taken in since it was last asked for."""
        if not self._changed:
            return None
        self._changed = False
        return self.now()


def _goes_on(time_s: float, silent_s: float, block: FeatureBlock) -> bool:
    """True of an interval that lies on the clock that ran before a stop, soon enough after it."""
    passed_s = block.time_s - block.duration_s - time_s
    begins_behind = passed_s > -0.5 * block.duration_s
    return begins_behind and silent_s - passed_s < SAME_CLOCK_S and silent_s < STOP_S
