"""One axis of the estimate node: its estimator, fed live, kept, and gone on with."""

import json
import logging

from ...clock import now_ns
from ...estimate.interface import PreloadEstimator
from ...messages.estimate import PreloadEstimate
from ...messages.features import FeatureBlock
from ...messages.header import Header
from ..stores.estimate_store import DAMAGED, EstimateStore, Kept, StateError

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
        self.taken = 0
        """Intervals, of all estimators that it had."""

    def take(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        """Take the next interval; what is known after it."""
        if self._heard is not None:
            self._bridge(*self._heard, header, block)
        self._heard = block.time_s, header.source_time_ns
        self._restored, self._changed = False, True
        self.taken += 1
        self._estimator.update(block)
        return self._estimator.estimate()

    def _bridge(self, time_s: float, heard_ns: int, header: Header, block: FeatureBlock) -> None:
        silent_s = (header.source_time_ns - heard_ns) / 1e9
        if self._restored and not _goes_on(time_s, silent_s, block):
            log.info("axis %s: its estimate continues after a stop of %.0f s", self._axis, silent_s)
            self._estimator.resume(silent_s)
        elif silent_s > SILENCE_S:
            self._estimator.interrupt()

    def forget(self) -> int:
        """The part is another; returns the number of intervals that were of the old one."""
        self._estimator.reset()
        self._heard, self._changed = None, False
        return self.taken

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns: nobody was silent meanwhile."""
        if self._heard is not None:
            self._heard = (self._heard[0], self._heard[1] + step_ns)

    def restore(self, store: EstimateStore, replaced_ns: int = 0) -> None:
        """Go on from what was kept, if it is this axis'; else begin anew, and say why.

        Args:
            replaced_ns: UNIX time at which the part was replaced, ns; 0 if it never was.
        """
        try:
            begun_ns = now_ns()
            kept = store.load(self._axis, begun_ns)
            if kept is None:
                return
            if kept.source_time_ns < replaced_ns <= begun_ns:
                raise StateError("it belongs to a part that has since been replaced")
            self._restore(kept)
        except (StateError, OSError) as error:
            aside = ""
            if isinstance(error, StateError) and error.damaged:
                aside = _set_aside(store, self._axis)
            path = store.path(self._axis)
            log.warning("%s: %s%s; the estimate of this axis starts over", path, error, aside)

    def begin(self, estimator: PreloadEstimator, kept: Kept | None = None) -> None:
        """Begin with another estimator, from a state. Raises StateError if it is none."""
        self._estimator = estimator
        self._heard, self._restored, self._changed = None, False, False
        if kept is not None:
            self._restore(kept)

    def now(self) -> Kept | None:
        """The state as of now; None if nothing was taken in."""
        if self._heard is None:
            return None
        return Kept(*self._heard, self._estimator.snapshot(), self.taken)

    def _restore(self, kept: Kept) -> None:
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
    """Tell whether an interval lies on the clock that ran before a stop, soon enough after it."""
    passed_s = block.time_s - block.duration_s - time_s
    begins_behind = passed_s > -0.5 * block.duration_s
    return begins_behind and silent_s - passed_s < SAME_CLOCK_S and silent_s < STOP_S


def _set_aside(store: EstimateStore, axis: str) -> str:
    try:
        return f", kept as {store.set_aside(axis).name}"
    except OSError as error:
        return f", and cannot be set aside ({error.strerror})"
