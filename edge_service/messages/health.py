"""Two healths, never mixed: the condition of an axis and the status of a component.

With the condition go alarms, headline and advice to whoever works at the axis (advisory
generation, ISO 13374-1), who answers with commands.
"""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from .estimate import EstimateStatus
from .event import AxisCondition, Statement
from .interval import Frozen, Interval, TimeNs
from .keys import check_component, check_recording
from .trend import Crossing, FrictionCurve, Trend, Use


class AlarmKind(StrEnum):
    """Subject of an alarm."""

    PRELOAD_LOW = "preload_low"  # below the warning limit
    PRELOAD_LOST = "preload_lost"  # below the fault limit
    RATE = "rate"  # wears faster than allowed
    SUDDEN_DROP = "sudden_drop"
    MODEL = "model"  # the model no longer fits what is measured
    DATA_LOST = "data_lost"
    SERVICE = "service"  # a part of the service does not work


class Alarm(Statement):
    """One alarm that is active, or that nobody has acknowledged yet, with its cause in words.

    Attributes:
        kind: `alarm` in JSON.
        active: its cause holds now.
        occurrence: number of this time that it was raised; each is greater than those before.
        raised_time_ns, cleared_time_ns: UNIX times, ns, of the last change either way.
        acknowledged_by, note: who took note of it, and their words; None if nobody.
        shelved_until_ns: until then it calls nobody; None if not shelved.
    """

    kind: AlarmKind = Field(alias="alarm")
    level: AxisCondition
    active: bool
    occurrence: int = Field(0, ge=0)
    raised_time_ns: TimeNs = Field(alias="raised_at")
    cleared_time_ns: TimeNs | None = Field(None, alias="cleared_at")
    acknowledged_by: str | None = None
    note: str = ""
    shelved_until_ns: TimeNs | None = Field(None, alias="shelved_until")


class Headline(Statement):
    """The one statement about an axis, from the worst of its condition and its alarms."""

    level: AxisCondition


class Task(StrEnum):
    """Task for a person; the codes never change."""

    INSPECT = "inspect"
    REPLACE_NUT = "replace_nut"
    CONFIRM_LOSS = "confirm_loss"
    PLAN_NUT = "plan_nut"
    FIND_WEAR = "find_wear"
    DIAGNOSE = "diagnose"
    REGREASE = "regrease"
    TEST = "test"
    FIND_CHANGE = "find_change"
    CHECK_SERVICE = "check_service"
    CHECK_CONNECTION = "check_connection"
    SWITCH_ON = "switch_on"
    COMPLETE_MACHINE_FILE = "complete_machine_file"
    COMMISSION_SOURCE = "commission_source"
    MOVE_FREELY = "move_freely"
    MOVE = "move"
    WAIT = "wait"
    ACKNOWLEDGE = "acknowledge"


class Advice(Frozen):
    """One task.

    Attributes:
        text: the task in words.
        now: it is due now.
        due: limit by which else; None where no date can be named.
        together_with: what else to do in the same stop.
    """

    task: Task
    text: str
    now: bool
    due: Crossing | None = None
    together_with: tuple[Task, ...] = ()


class PreloadFall(Frozen):
    """Sudden fall of the preload, remembered until a part is replaced.

    Attributes:
        from_percent, to_percent: percent of the fresh screw's preload.
        time_ns: UNIX time, ns; `time` in JSON.
    """

    from_percent: float
    to_percent: float
    time_ns: TimeNs = Field(alias="time")


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
    since_time_ns: TimeNs | None = Field(None, alias="since")
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
        of_fresh: preload, percent of the fresh screw's; None where there is no number. Headline
            and alarms are formed from it.
        measured_time_ns: UNIX time of the newest sample behind it, ns; None before the first;
            `measured_at` in JSON.
        limits: None if the fresh preload is not known.
        next_limit: the first limit ahead for which there is a date.
        since_time_ns: UNIX time in ns at which the condition was entered; `since` in JSON.
        data_faults: count of faulty intervals per kind since start.
        alarms: those that a person should see, the gravest first.
        trend, use, friction, consistency: None where nobody keeps them.
        headline: the one statement from the worst of condition and alarms.
        advice: tasks for a person, the most urgent first; empty if there is nothing to do.
        fall: the last sudden fall of the preload since a part was replaced.
    """

    axis: str
    condition: AxisCondition
    status: EstimateStatus = EstimateStatus.UNESTIMATED
    method: str | None = None
    of_fresh: Interval | None = None
    measured_time_ns: TimeNs | None = Field(None, alias="measured_at")
    limits: Limits | None = None
    next_limit: Crossing | None = None
    reasons: tuple[str, ...] = ()
    since_time_ns: TimeNs = Field(alias="since")
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


class Command(Frozen):
    """Command given by a person about one axis.

    Attributes:
        action: `acknowledge`, `shelve` or `unshelve` an alarm; write a `note`; say that a part
            was replaced or set anew (`part_replaced`), which begins its trend and use anew; or that
            the trace named by the note is kept (`recorded`, from the service itself).
        alarm: the alarm meant; None for the other actions.
        occurrence: which time of that alarm `acknowledge` means; refused once that is over.
        user: who asks.
        note: their words.
        duration_s: how long to shelve, s.
        origin: address from which it was asked; empty for a client of the bus.
        key: of the asker's choice, so that the same command may be asked again after a lost answer
            without being done twice; empty: it is done each time.
    """

    action: Literal["acknowledge", "shelve", "unshelve", "note", "part_replaced", "recorded"]
    alarm: AlarmKind | None = None
    occurrence: int | None = Field(None, ge=0)
    user: str = Field(min_length=1, max_length=100)
    note: str = Field("", max_length=1000)
    duration_s: float = Field(8 * 3600.0, gt=0.0, le=30 * 86400.0)
    origin: str = Field("", max_length=200)
    key: str = Field("", max_length=100)

    @model_validator(mode="after")
    def _own_recording(self) -> Self:
        if self.action == "recorded":
            check_recording(self.note)
        return self


class Outcome(Frozen):
    """Outcome of a command.

    Attributes:
        accepted: whether it was done.
        kept: whether it is on the disk, so that it outlives a crash; True where nothing is kept.
        message: what was done, or why not.
        reused: whether the command was refused because its key belongs to another one.
    """

    accepted: bool
    kept: bool = True
    message: str = ""
    reused: bool = False
