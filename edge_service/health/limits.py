"""Limits of the preload: the condition that estimates support."""

import math

from ..config_tables import AlarmsConfig
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition
from ..messages.health import Limits
from .inputs import NS_PER_S

HYSTERESIS_SHARE = 0.05
"""Rise above a limit that ends it, share of the fresh preload."""
GRACE_NS = 10 * NS_PER_S
"""So long a condition is kept while estimates come, but without a number."""
_DELAY_NS = round(0.3 * NS_PER_S)
"""So long the whole interval must lie beyond a limit."""
_DOUBT_DELAY_NS = 10 * NS_PER_S
"""So long the value must lie beyond a limit that its interval still straddles."""


def limits_of(settings: AlarmsConfig, fresh_percent: float | None) -> Limits | None:
    """Limits of an axis, percent of the load rating; None if the fresh preload is not known."""
    if fresh_percent is None:
        return None
    point = fresh_percent / 100.0
    return Limits(
        fresh_percent=fresh_percent,
        warning_percent=settings.warning_percent * point,
        fault_percent=settings.fault_percent * point,
    )


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

    def update(self, value: float, low: float, high: float, time_ns: int) -> None:
        """Take one estimate in, percent; `time_ns` is the time of its newest sample."""
        if self.below:
            beyond = value >= self.release_percent
            certain = beyond and low >= self.limit_percent
        else:
            beyond = value < self.limit_percent
            certain = beyond and high < self.limit_percent
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

    def __init__(self, limits: Limits) -> None:
        margin = HYSTERESIS_SHARE * limits.fresh_percent
        self._fresh_percent = limits.fresh_percent
        self._warning = LimitLatch(limits.warning_percent, limits.warning_percent + margin)
        self._fault = LimitLatch(limits.fault_percent, limits.fault_percent + margin)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._confirmed = False
        self._high = math.inf

    def restart(self) -> None:
        """After an interruption: keep the states of the limits, ask for new evidence."""
        self._first_ns = None
        self._confirmed = False
        self._warning.restart()
        self._fault.restart()

    def update(self, estimate: PreloadEstimate, time_ns: int) -> None:
        """Take one estimate in; without bounds nothing is certain.

        Args:
            time_ns: time of its newest sample.
        """
        value = estimate.preload_percent
        if value is None or estimate.status is not EstimateStatus.ESTIMATED:
            return
        if not 0 <= time_ns - self._last_ns <= GRACE_NS:
            self.restart()
        if self._first_ns is None:
            self._first_ns = time_ns
        self._last_ns = time_ns
        low = -math.inf if estimate.low is None else estimate.low
        self._high = math.inf if estimate.high is None else estimate.high
        self._warning.update(value, low, self._high, time_ns)
        self._fault.update(value, low, self._high, time_ns)
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
        """Reasons why the condition is not NORMAL; their codes say whether that is in doubt."""
        if self.condition not in (AxisCondition.FAULT, AxisCondition.WARNING):
            return ()
        is_fault = self.condition is AxisCondition.FAULT
        latch, name = (self._fault, "fault") if is_fault else (self._warning, "warning")
        limit = 100.0 * latch.limit_percent / self._fresh_percent
        if self._high < latch.limit_percent:
            return (f"below_{name}: the preload is below {limit:.3g} % of fresh",)
        return (f"may_be_below_{name}: the preload may be below {limit:.3g} % of fresh",)


def _since(since: int | None, holds: bool, time_ns: int) -> int | None:
    if not holds:
        return None
    return time_ns if since is None else since


def _lasted(since: int | None, time_ns: int, delay_ns: int) -> bool:
    return since is not None and time_ns - since >= delay_ns
