"""Limits of the preload: their settings, and the condition that they make of an estimate."""

import math
from dataclasses import dataclass

from ..messages.event import AxisCondition, Code, Statement, told
from ..messages.health import Limits
from .inputs import NS_PER_S, moved

HYSTERESIS_PERCENT = 5.0
"""Rise above a limit that ends it, percent of the fresh preload."""
GRACE_NS = 10 * NS_PER_S
"""So long a condition is kept while estimates come, but without a number."""
_DELAY_NS = round(0.3 * NS_PER_S)
"""So long the whole interval must lie beyond a limit."""
_DOUBT_DELAY_NS = 10 * NS_PER_S
"""So long the value must lie beyond a limit that its interval still straddles."""


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of one axis, all in percent of the dynamic load rating."""

    fresh_percent: float
    warning_percent: float
    fault_percent: float
    hysteresis_percent: float

    @property
    def shown(self) -> Limits:
        """Those that people see."""
        return Limits(
            fresh_percent=self.fresh_percent,
            warning_percent=self.warning_percent,
            fault_percent=self.fault_percent,
        )


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """Limits of the condition, a convention that the owner may change.

    Attributes:
        warning_below_percent: WARNING below this share of the fresh preload, percent.
        fault_below_percent: FAULT below this share of the fresh preload, percent.
    """

    warning_below_percent: float = 60.0
    fault_below_percent: float = 30.0

    def limits(self, fresh_preload_percent: float | None) -> AxisLimits | None:
        """Limits of an axis, or None where the fresh screw's preload is not known.

        Args:
            fresh_preload_percent: Preload of the fresh screw in percent of the dynamic load rating.
        """
        if fresh_preload_percent is None:
            return None
        point = fresh_preload_percent / 100.0
        return AxisLimits(
            fresh_percent=fresh_preload_percent,
            warning_percent=self.warning_below_percent * point,
            fault_percent=self.fault_below_percent * point,
            hysteresis_percent=HYSTERESIS_PERCENT * point,
        )


@dataclass(frozen=True, slots=True)
class PreloadBounds:
    """Preload with its interval, in percent of the dynamic load rating."""

    value: float
    low: float
    high: float


class LimitLatch:
    """Latch that tells whether preload lies below one limit.

    It switches when the whole interval has been beyond the limit for 0.3 s, or the value for
    10 s. So a clear drop shows within a few estimates, while a doubtful one (the limit
    inside the interval) needs time, but cannot hide behind a wide interval for ever. To switch
    back the value must rise above the limit by the hysteresis. Contrary evidence restarts the
    delay; missing evidence does not, or a real drop could hide behind stop-and-go motion.
    """

    def __init__(self, limit_percent: float, release_percent: float) -> None:
        self.below = False
        self.limit_percent = limit_percent
        self.release_percent = release_percent
        self._doubtful_since: int | None = None
        self._certain_since: int | None = None

    def restart(self) -> None:
        """Forget evidence for a change; the state stays."""
        self._doubtful_since = self._certain_since = None

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._doubtful_since = moved(self._doubtful_since, step_ns)
        self._certain_since = moved(self._certain_since, step_ns)

    def update(self, bounds: PreloadBounds, time_ns: int) -> None:
        """Take one estimate in; `time_ns` is the time of its newest sample."""
        if self.below:
            beyond = bounds.value >= self.release_percent
            certain = beyond and bounds.low >= self.limit_percent
        else:
            beyond = bounds.value < self.limit_percent
            certain = beyond and bounds.high < self.limit_percent
        self._doubtful_since = _since(self._doubtful_since, beyond, time_ns)
        self._certain_since = _since(self._certain_since, certain, time_ns)
        if _lasted(self._certain_since, time_ns, _DELAY_NS) or _lasted(
            self._doubtful_since, time_ns, _DOUBT_DELAY_NS
        ):
            self.below = not self.below
            self.restart()


class LimitTracker:
    """Condition of an axis from its estimates.

    `condition` is None until the first estimates have lasted for 0.3 s: at a start, or after
    an interruption, a screw without preload is never called NORMAL first.
    """

    def __init__(self, limits: AxisLimits) -> None:
        margin = limits.hysteresis_percent
        self._limits = limits
        self._warning = LimitLatch(limits.warning_percent, limits.warning_percent + margin)
        self._fault = LimitLatch(limits.fault_percent, limits.fault_percent + margin)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._confirmed = False
        self._bounds = PreloadBounds(0.0, 0.0, 0.0)

    def restart(self) -> None:
        """After an interruption: keep the states of the limits, ask for new evidence."""
        self._first_ns = None
        self._confirmed = False
        self._warning.restart()
        self._fault.restart()

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._first_ns = moved(self._first_ns, step_ns)
        self._last_ns += step_ns
        self._warning.move(step_ns)
        self._fault.move(step_ns)

    def update(self, bounds: PreloadBounds, time_ns: int) -> None:
        """Take one estimate in; `time_ns` is the time of its newest sample."""
        if not 0 <= time_ns - self._last_ns <= GRACE_NS:
            self.restart()
        if self._first_ns is None:
            self._first_ns = time_ns
        self._last_ns = time_ns
        self._bounds = bounds
        self._warning.update(bounds, time_ns)
        self._fault.update(bounds, time_ns)
        self._confirmed = self._confirmed or time_ns - self._first_ns >= _DELAY_NS

    @property
    def condition(self) -> AxisCondition | None:
        """Condition that the estimates support; None if they have not lasted long enough."""
        if not self._confirmed:
            return None
        if self._fault.below:
            return AxisCondition.FAULT
        return AxisCondition.WARNING if self._warning.below else AxisCondition.NORMAL

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the condition is not NORMAL."""
        if self.below is None:
            return ()
        code = "below_fault" if self.condition is AxisCondition.FAULT else "below_warning"
        return (f"{code}: {self.below.text}",)

    @property
    def below(self) -> Statement | None:
        """Preload against the limit below which it is, or seems to be; None if it is not."""
        if self.condition not in (AxisCondition.FAULT, AxisCondition.WARNING):
            return None
        latch = self._fault if self.condition is AxisCondition.FAULT else self._warning
        share = 100.0 / self._limits.fresh_percent
        limit, release = share * latch.limit_percent, share * latch.release_percent
        percent, high = share * self._bounds.value, share * self._bounds.high
        if not limit <= high < math.inf:
            return told(Code.PRELOAD_BELOW, percent=percent, limit=limit, release=release)
        return told(
            Code.PRELOAD_MAY_BE_BELOW, percent=percent, high=high, limit=limit, release=release
        )


def _since(since: int | None, holds: bool, time_ns: int) -> int | None:
    if not holds:
        return None
    return time_ns if since is None else since


def _lasted(since: int | None, time_ns: int, delay_ns: int) -> bool:
    return since is not None and time_ns - since >= delay_ns
