"""Two healths, never mixed: the condition of an axis and the status of a component."""

from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, Field

from .advice import Advice, Headline, PreloadFall
from .alarm import Alarm
from .components import check_component
from .estimate import EstimateStatus, Frozen, Interval
from .sentence import Code, Sentence, is_none
from .trend import Crossing, FrictionCurve, Trend, Use


class AxisCondition(StrEnum):
    """Condition of an axis, in the words of MTConnect."""

    NORMAL = "NORMAL"
    WARNING = "WARNING"
    FAULT = "FAULT"
    UNAVAILABLE = "UNAVAILABLE"


class ComponentStatus(StrEnum):
    """Status of a part of the service (after the OpenTelemetry Collector)."""

    STARTING = "starting"
    OK = "ok"
    RECOVERABLE_ERROR = "recoverable_error"
    PERMANENT_ERROR = "permanent_error"
    STOPPING = "stopping"
    STOPPED = "stopped"


class ComponentHealth(Frozen):
    """Status of one component, with the counters worth looking at.

    Attributes:
        component: one of `COMPONENTS`, or an output.
        axis: the axis it works for, or None if it serves all.
        counters: monotonic counts since start, e.g. `samples`, `lost_payloads`, `ring_overruns`.
        readings: values that it wants seen, e.g. the simulated drive's `true_preload_percent`.
    """

    component: Annotated[str, AfterValidator(check_component)]
    axis: str | None = None
    status: ComponentStatus
    reason: str = ""
    counters: dict[str, int] = {}
    readings: dict[str, float] = {}


class ConsistencyState(StrEnum):
    """State of the check that an axis still does what it did when it was learned."""

    LEARNING = "learning"
    AGREES = "agrees"
    DISAGREES = "disagrees"


class Consistency(Frozen):
    """Model against axis, over sustained motion.

    Attributes:
        ratio: mean squared innovation by channel, over that of an average stretch; 1 is expected.
        channel: where they disagree most; None while they agree.
        since_time_ns: UNIX time in ns at which that began.
        recording: name of the trace around that moment, once it is kept.
    """

    state: ConsistencyState = ConsistencyState.LEARNING
    ratio: dict[str, float] = {}
    channel: str | None = None
    since_time_ns: int | None = None
    recording: str | None = None


class Limits(Frozen):
    """Limits of one axis, percent of the dynamic load rating.

    Attributes:
        fresh_percent: preload of the fresh screw.
        warning_percent, fault_percent: WARNING and FAULT below this preload.
    """

    fresh_percent: float
    warning_percent: float
    fault_percent: float


class AxisHealth(Frozen):
    """Condition of one axis, why, since when, and the state of the data behind it.

    Attributes:
        status, method: of the estimate that it rests on.
        of_fresh: preload, percent of the fresh screw's; None where there is no number.
        measured_time_ns: UNIX time of the newest sample behind it, ns; None before the first.
        limits: None if the fresh preload is not known.
        next_limit: the first limit ahead for which there is a date.
        since_time_ns: UNIX time in ns at which the condition was entered.
        data_faults: count of faulty intervals per kind since start.
        alarms: those that a person should see, the gravest first.
        trend, use, friction, consistency: None where nobody keeps them.
        headline: the one statement from the worst of condition and alarms.
        advice: tasks for a person, the most urgent first; empty if there is nothing to do.
        below: how far below a limit, for readers of any language; None unless it is, or seems so.
        fall: the last sudden fall of the preload since a part was replaced.
    """

    axis: str
    condition: AxisCondition
    status: EstimateStatus = EstimateStatus.UNESTIMATED
    method: str | None = None
    of_fresh: Interval | None = None
    measured_time_ns: int | None = None
    limits: Limits | None = None
    next_limit: Crossing | None = None
    reasons: tuple[str, ...] = ()
    since_time_ns: int
    components: tuple[ComponentHealth, ...] = ()
    data_faults: dict[str, int] = {}
    alarms: tuple[Alarm, ...] = ()
    trend: Trend | None = None
    use: Use | None = None
    friction: FrictionCurve | None = None
    consistency: Consistency | None = None
    headline: Headline | None = None
    advice: tuple[Advice, ...] = ()
    fall: PreloadFall | None = None
    below: Sentence | None = Field(None, exclude_if=is_none)

    @property
    def is_in_doubt(self) -> bool:
        """Tell whether the preload may as well be above the limit that the condition rests on."""
        return self.below is not None and self.below.code == Code.PRELOAD_MAY_BE_BELOW
