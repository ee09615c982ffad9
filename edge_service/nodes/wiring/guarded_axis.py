"""One axis whose estimator may raise: no number comes from a state that was left half made."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from ...estimate.interface import PreloadEstimator
from ...messages.estimate import EstimateStatus, PreloadEstimate
from ...messages.features import FeatureBlock
from ...messages.header import Header
from ..supervision.failures import Borne
from ..supervision.policy import RestartPolicy, Restarts
from ..supervision.words import said
from .estimate_state import Kept
from .estimated_axis import EstimatedAxis

POLICY = RestartPolicy(first_s=0.5, cap_s=30.0, most=1 << 62, steady_s=60.0)
MOST_BLAMED = 3
"""Times that a state may be to blame."""
SOUND_PERIOD = 10
"""Intervals after which the state is remembered."""


class GuardedAxis:
    """Feeds an axis; when its estimator raises, another goes on from the last sound state.

    Where a fresh one takes the interval at which it raised, the state is to blame; if it is three
    times before another sound one comes, it is given up. Otherwise it is the interval.

    Args:
        make: makes an estimator of the axis.
        note: told every error.
        tell_reset: told when a state is given up.
        clock: monotonic, s.
    """

    def __init__(
        self,
        axis: str,
        make: Callable[[], PreloadEstimator],
        note: Callable[[Exception], None],
        tell_reset: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._axis = EstimatedAxis(axis, make())
        self._make, self._note, self._tell_reset, self._clock = make, note, tell_reset, clock
        self._pauses = Restarts(POLICY)
        self._begun_s = self._due_s = clock()
        self._sound: Kept | None = None
        self._since_sound = self._blamed = self.resets = 0
        self.problem = ""
        """Reason for which there is no number; empty while the estimator works."""

    def take(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        """Take the next interval; what is known after it, no number while the estimator fails."""
        failed = bool(self.problem)
        if failed and self._clock() < self._due_s:
            return self._nothing(block)
        estimate = None
        with Borne(partial(self._failed, block)):
            estimate = (self._again if failed else self._go_on)(header, block)
        return estimate or self._nothing(block)

    def load(self, kept: Kept) -> None:
        """Go on from what was kept. Raises StateError if that is none."""
        self._axis.restore(kept)
        self._sound = self._axis.now()

    def to_keep(self) -> Kept | None:
        """The state, if something was taken in since it was last asked for and it is sound."""
        kept = None
        if not self.problem:
            with Borne(partial(self._failed, None)):
                kept = self._axis.to_keep()
        return kept

    def forget(self) -> None:
        """Begin anew: the part is another."""
        self._axis.begin(self._make())
        self._sound, self.problem, self._blamed = None, "", 0

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._axis.move(step_ns)
        if self._sound is not None:
            moved_ns = self._sound.source_time_ns + step_ns
            self._sound = replace(self._sound, source_time_ns=moved_ns)

    def _go_on(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        estimate = self._axis.take(header, block)
        self._since_sound += 1
        if self._since_sound >= SOUND_PERIOD:
            self._sound, self._since_sound, self._blamed = self._axis.now(), 0, 0
        return estimate

    def _again(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        """Take an interval with another estimator, from the last sound state."""
        self._begun_s = self._clock()
        self._axis.begin(self._make(), self._sound)
        estimate = self._axis.take(header, block)
        self.problem, self._since_sound = "", 0
        return estimate

    def _failed(self, block: FeatureBlock | None, error: Exception) -> None:
        now_s = self._clock()
        pause_s = self._pauses.pause_s(now_s - self._begun_s)
        self._due_s = now_s + (pause_s or POLICY.cap_s)
        self.problem = f"the estimator fails: {said(error)}"
        self._note(error)
        if block is not None and self._sound is not None:
            with Borne(lambda _error: None):  # the interval is to blame
                self._take_fresh(block)
                self._blame(error)

    def _take_fresh(self, block: FeatureBlock) -> None:
        fresh = self._make()
        fresh.update(block)
        fresh.estimate()

    def _blame(self, error: Exception) -> None:
        """Give the state up if it is to blame too often."""
        self._blamed += 1
        if self._blamed >= MOST_BLAMED:
            self._sound, self._blamed = None, 0
            self.resets += 1
            self._tell_reset(f"starts over: its state cannot be continued ({said(error)})")

    def _nothing(self, block: FeatureBlock) -> PreloadEstimate:
        return PreloadEstimate(
            time_s=block.time_s,
            status=EstimateStatus.UNESTIMATED,
            reasons=(f"estimator_failed: {self.problem}",),
        )
