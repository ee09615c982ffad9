"""One axis that is estimated: its estimator, fed live, kept, gone on with, and begun anew."""

import hashlib
import json
import logging
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from pydantic import FiniteFloat, TypeAdapter

from ..config_tables import Table
from ..estimate.interface import PreloadEstimator
from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.features import FeatureBlock
from ..models.commissioned import Notch
from ..models.machine import Machine
from ..retry import Retry

log = logging.getLogger(__name__)
SCHEMA = "estimate-state/2"
LONGEST_STOP_S = 30 * 86400.0
"""After a longer stop nothing is left of what was known."""
AHEAD_S = 60.0
"""A state this far in the future is of a wrong clock, and counts as stopped for the longest."""
DAMAGED = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
SILENCE_S = 10.0
"""Without features for this long, what was known before is of unknown age."""
SAME_CLOCK_S = 60.0
"""By so much the axis' clock may have lost of a stop and still be the one that ran before it."""
STOP_S = 600.0
"""In a longer stop that nobody saw, an axis may have become another."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
MOST_FAILURES = 3
"""Times that an estimator may raise after one sound state."""
SOUND_PERIOD = 10  # intervals after which the state is remembered


class StateError(Exception):
    """Reason for not going on from a kept state; `damaged` if it is none at all."""

    def __init__(self, reason: str, *, damaged: bool = False) -> None:
        super().__init__(reason)
        self.damaged = damaged


@dataclass(frozen=True, slots=True)
class Kept:
    """An estimator's snapshot with the end of the last interval that it has taken."""

    time_s: FiniteFloat  # on the axis' clock
    source_time_ns: int  # UNIX time
    snapshot: dict[str, Any]

    def document(self, axis: str, identity: str) -> dict[str, Any]:
        return {"schema": SCHEMA, "axis": axis, "machine": identity, **asdict(self)}

    @classmethod
    def of(cls, document: Any, axis: str, identity: str) -> "Kept":
        """State of a document. Raises StateError."""
        try:
            content = dict(document)
            schema, of, machine = (content.pop(name) for name in ("schema", "axis", "machine"))
            if (schema, of) != (SCHEMA, axis):
                raise ValueError(f"{schema} of axis {of}")
            kept = _KEPT.validate_python(content)
        except DAMAGED as error:
            first, *_ = str(error).splitlines() or [""]
            reason = f"it cannot be read ({type(error).__name__}: {first[:100]})"
            raise StateError(reason, damaged=True) from None
        if machine != identity:
            raise StateError("it was saved with another machine file or estimator")
        return kept

    def as_of(self, now_ns: int, replaced_ns: int = 0) -> "Kept":
        """State to go on with now; the part may have been replaced since. Raises StateError."""
        stopped_s = (now_ns - self.source_time_ns) / 1e9
        if stopped_s > LONGEST_STOP_S:
            raise StateError(f"it is {stopped_s / 86400.0:.0f} days old")
        kept = self
        if stopped_s < -AHEAD_S:
            log.warning("the state of an estimate is from %.0f s in the future", -stopped_s)
            kept = replace(self, source_time_ns=now_ns - round(LONGEST_STOP_S * 1e9))
        if kept.source_time_ns < replaced_ns <= now_ns:
            raise StateError("it belongs to a part that has since been replaced")
        return kept


_KEPT = TypeAdapter(Kept)


def identity_of(machine: Machine, *tables: Table) -> str:
    """Digest of all that the numbers of a state rest on: machine file and choices."""
    text = "\n".join(each.model_dump_json() for each in (machine, *tables))
    return hashlib.sha256(text.encode()).hexdigest()


class EstimatedAxis:
    """Feeds an estimator; where that raises, another goes on from the last sound state.

    A state after which it raises three times before another sound one comes is given up.

    Args:
        note: told every error; returns it in words.
        tell_reset: told why a state is given up.

    Attributes:
        problem: reason for which there is no number; empty while the estimator works.
        resets, failed: states that were given up, and times that an estimator has raised.
    """

    def __init__(
        self,
        axis: str,
        make: Callable[[], PreloadEstimator],
        note: Callable[[Exception], str],
        tell_reset: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._axis, self._make = axis, make
        self._note, self._tell_reset, self._clock = note, tell_reset, clock
        self._retry, self._due_s = Retry(FIRST_PAUSE_S, LONGEST_PAUSE_S), 0.0
        self._sound: Kept | None = None
        self._heard: tuple[float, int] | None = None
        self._is_restored = self._is_changed = False
        self._since_sound = self._failures = self.resets = self.failed = 0
        self.problem = ""
        self._begin(None)

    def forget(self) -> None:
        """Begin anew: the part is another."""
        self._sound, self.problem, self._failures = None, "", 0
        self._begin(None)

    def load(self, kept: Kept) -> None:
        """Go on from a state. Raises StateError if it is none, and begins anew then."""
        try:
            self._begin(kept)
            self._estimator.estimate()  # numbers of the right shape may still mean nothing
            json.dumps(self._estimator.snapshot(), allow_nan=False)
        except DAMAGED as error:
            self.forget()
            reason = f"it is not a state of this estimator ({error})"
            raise StateError(reason, damaged=True) from None
        self._sound = kept

    def take(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        """Take the next interval; what is known after it, no number while the estimator fails."""
        if not self.problem or self._clock() >= self._due_s:
            try:
                if self.problem:
                    self._begin(self._sound)
                estimate = self._update(header, block)
            except Exception as error:
                log.debug("axis %s", self._axis, exc_info=True)
                self._failed(error)
            else:
                self.problem = ""
                return estimate
        status, reasons = EstimateStatus.UNESTIMATED, (f"estimator_failed: {self.problem}",)
        return PreloadEstimate(time_s=block.time_s, status=status, reasons=reasons)

    def take_test(self, seen: Notch) -> PreloadEstimate:
        """Give the estimator a test that has just ended. Raises ValueError: it says nothing."""
        take: Callable[..., PreloadEstimate] | None = getattr(self._estimator, "take_test", None)
        if self.problem or take is None or self._heard is None:
            raise ValueError(self.problem or "this estimator takes no tests")
        self._is_changed, self._since_sound = True, SOUND_PERIOD
        return take(seen, self._heard[0])

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns: nobody was silent meanwhile."""
        if self._heard is not None:
            self._heard = (self._heard[0], self._heard[1] + step_ns)
        if self._sound is not None:
            moved_ns = self._sound.source_time_ns + step_ns
            self._sound = replace(self._sound, source_time_ns=moved_ns)

    def to_keep(self) -> Kept | None:
        """The state, if something was taken in since it was last asked for and it is sound."""
        if self.problem or not self._is_changed or self._heard is None:
            return None
        self._is_changed = False
        try:
            return Kept(*self._heard, self._estimator.snapshot())
        except Exception as error:
            log.debug("axis %s", self._axis, exc_info=True)
            self._failed(error)
            return None

    def _begin(self, kept: Kept | None) -> None:
        self._estimator = self._make()
        self._heard, self._since_sound = None, 0
        self._is_restored, self._is_changed = kept is not None, False
        if kept is not None:
            self._estimator.restore(kept.snapshot)
            self._heard = kept.time_s, kept.source_time_ns

    def _update(self, header: Header, block: FeatureBlock) -> PreloadEstimate:
        if self._heard is not None:
            time_s, heard_ns = self._heard
            silent_s = (header.source_time_ns - heard_ns) / 1e9
            passed_s = block.time_s - block.duration_s - time_s  # on the clock of before the stop
            begins_behind = passed_s > -0.5 * block.duration_s
            goes_on = begins_behind and silent_s - passed_s < SAME_CLOCK_S and silent_s < STOP_S
            if self._is_restored and not goes_on:
                log.info(
                    "axis %s: its estimate continues after a stop of %.0f s", self._axis, silent_s
                )
                self._estimator.resume(silent_s)
            elif silent_s > SILENCE_S:
                self._estimator.interrupt()
        self._heard = block.time_s, header.source_time_ns
        self._is_restored, self._is_changed = False, True
        self._estimator.update(block)
        estimate = self._estimator.estimate()
        self._since_sound += 1
        if self._since_sound >= SOUND_PERIOD:
            self._sound = Kept(*self._heard, self._estimator.snapshot())
            self._since_sound, self._failures = 0, 0
            self._retry.reset()
        return estimate

    def _failed(self, error: Exception) -> None:
        self.problem = self._note(error)
        self._due_s = self._clock() + self._retry.pause_s()
        self._failures, self.failed = self._failures + 1, self.failed + 1
        if self._sound is not None and self._failures >= MOST_FAILURES:
            self._sound, self._failures = None, 0
            self.resets += 1
            self._tell_reset(self.problem)
