"""Answers of the JSON routes.

An answer is made of the message that it shows by `Answer.model_validate(message)`: members come
from the attributes of the same name, or of the name that their `validation_alias` gives. What is
shown as it is has no answer of its own.
"""

import math
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from ..health.store.rows import Spread
from ..messages.advice import Headline, Subject, Task
from ..messages.alarm import AlarmKind
from ..messages.estimate import EstimateStatus, Interval
from ..messages.event import Severity
from ..messages.health import AxisCondition, ComponentHealth, ConsistencyState, Limits
from ..messages.sentence import Sentence, is_none
from ..messages.trend import TrendStatus
from .times import rfc3339, rfc3339_s


def _written(time: int | float | str) -> str:
    """A time as it is shown: an integer is UNIX time in ns, a float in s."""
    if isinstance(time, str):
        return time
    return rfc3339(time) if isinstance(time, int) else rfc3339_s(time)


Timestamp = Annotated[
    str,
    BeforeValidator(_written),
    WithJsonSchema(
        {"type": "string", "format": "date-time", "examples": ["2026-01-31T12:00:00.000Z"]}
    ),
]
"""RFC 3339 in UTC, with milliseconds."""

_PRELOAD_EXAMPLE: dict[str, Any] = {
    "axis": "X",
    "status": "estimated",
    "preload_percent": 6.71,
    "low": 6.58,
    "high": 6.84,
    "level": 0.95,
    "of_fresh": {"value": 98.0, "low": 96.1, "high": 99.9},
    "preload_n": 500.1,
    "drag_torque_nm": {"value": 0.141, "low": 0.139, "high": 0.143},
    "stiffness_n_per_m": {"value": 3.6e7, "low": 3.4e7, "high": 3.8e7},
    "condition": "NORMAL",
    "reasons": [],
    "mode_probability": {"10": 0.0, "7.5": 0.9, "5": 0.1},
    "fault_probability": {"preload_loss": 0.01, "lubrication": 0.02, "looseness": 0.0},
    "measured_at": "2026-01-31T12:00:00.000Z",
    "age_s": 0.12,
}


class Answer(BaseModel):
    """Base of every answer: no NaN, nothing beyond the documented members."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        from_attributes=True,
        populate_by_name=True,
    )


class PreloadAnswer(Answer):
    """Preload of one axis; numbers are null unless the status is `estimated`."""

    model_config = ConfigDict(json_schema_extra={"examples": [_PRELOAD_EXAMPLE]})

    axis: str
    status: EstimateStatus = Field(description="Whether the numbers may be read.")
    method: str | None = Field(default=None, description="Estimator that says so.")
    preload_percent: float | None = Field(
        description="Preload in percent of the screw's dynamic load rating."
    )
    low: float | None = Field(description="Lower bound of the interval, percent.")
    high: float | None = Field(description="Upper bound of the interval, percent.")
    level: float = Field(
        description="Probability with which the interval should contain the true value."
    )
    of_fresh: Interval | None = Field(
        default=None, description="The same in percent of the fresh screw's preload."
    )
    preload_n: float | None = Field(description="Preload, N.")
    drag_torque_nm: Interval | None = Field(
        description="Coulomb drag torque of the axis at the motor shaft, N m."
    )
    stiffness_n_per_m: Interval | None = Field(
        description="Stiffness between motor and table, N/m; null if it is not estimated."
    )
    condition: AxisCondition
    reasons: list[str] = Field(description="Why, as `code: sentence`; empty if all is well.")
    mode_probability: dict[str, float] = Field(
        description="Probability of each preload level (percent) of the filter bank."
    )
    fault_probability: dict[str, float] = Field(
        description="Probability of each change since commissioning; empty without commissioning."
    )
    measured_at: Timestamp | None = Field(
        description="Time of the newest sample behind the last estimate; null if there is none."
    )
    age_s: float | None = Field(description="Time since then, s.")


Told = Annotated[
    Sentence | None,
    Field(
        exclude_if=is_none,
        description="The message as a code with its values, for other languages; absent without.",
    ),
]
_ALARM_EXAMPLE: dict[str, Any] = {
    "alarm": "sudden_drop",
    "occurrence": 1769860800000,
    "severity": "error",
    "active": True,
    "message": "preload fell suddenly by 64 points, from 100 to 36 % of the fresh screw's",
    "raised_at": "2026-01-31T12:00:00.000Z",
    "cleared_at": None,
    "acknowledged_by": None,
    "note": "",
    "shelved_until": None,
}


class AlarmAnswer(Answer):
    """An alarm that is active, or that nobody has acknowledged yet."""

    model_config = ConfigDict(json_schema_extra={"examples": [_ALARM_EXAMPLE]})

    alarm: AlarmKind = Field(validation_alias="kind")
    occurrence: int = Field(description="Which time of this alarm; `acknowledge` names it.")
    severity: Severity
    active: bool = Field(description="Whether its cause is present now.")
    message: str
    raised_at: Timestamp = Field(validation_alias="raised_time_ns")
    cleared_at: Timestamp | None = Field(validation_alias="cleared_time_ns")
    acknowledged_by: str | None = Field(description="null if nobody has acknowledged it yet.")
    note: str
    shelved_until: Timestamp | None = Field(
        validation_alias="shelved_until_ns", description="Until then it alerts nobody."
    )
    sentence: Told = None


class CrossingAnswer(Answer):
    """Time at which a limit will be reached, if the wear goes on as it does."""

    limit: str = Field(examples=["fault"])
    limit_percent: float
    earliest: Timestamp | None = Field(validation_alias="earliest_ns")
    likely: Timestamp | None = Field(validation_alias="likely_ns")
    latest: Timestamp | None = Field(
        validation_alias="latest_ns", description="null if the history is too short to tell."
    )


_TREND_EXAMPLE: dict[str, Any] = {
    "status": "falling",
    "reason": "the preload is falling",
    "since": "2026-01-01T06:00:00.000Z",
    "basis": "distance",
    "level": 0.9,
    "rate_percent_per_h": {"value": -1.2e-3, "low": -1.4e-3, "high": -1.0e-3},
    "rate_fresh_percent_per_h": {"value": -1.8e-2, "low": -2.1e-2, "high": -1.5e-2},
    "rate_percent_per_km": {"value": -4.1e-3, "low": -4.6e-3, "high": -3.7e-3},
    "crossings": [
        {
            "limit": "fault",
            "limit_percent": 2.05,
            "earliest": "2026-06-11T00:00:00.000Z",
            "likely": "2026-07-12T00:00:00.000Z",
            "latest": "2026-08-23T00:00:00.000Z",
        }
    ],
}


class TrendAnswer(Answer):
    """Trend of the preload since the part came into use, or since it last jumped."""

    model_config = ConfigDict(json_schema_extra={"examples": [_TREND_EXAMPLE]})

    status: TrendStatus
    reason: str
    since: Timestamp | None = Field(
        validation_alias="since_time_ns", description="null if there is no history yet."
    )
    basis: str = Field(description="What wear is counted against: `time` or `distance`.")
    level: float = Field(description="Probability that each interval contains the true value.")
    rate_percent_per_h: Interval | None
    rate_percent_per_km: Interval | None
    rate_fresh_percent_per_h: Interval | None = Field(
        description="Change in percent of the fresh screw's preload per hour."
    )
    crossings: list[CrossingAnswer] = Field(description="Empty unless the preload is falling.")


_CONSISTENCY_EXAMPLE: dict[str, Any] = {
    "state": "disagrees",
    "ratio": {"torque_nm": 1.2, "transmission_m": 310.0},
    "channel": "transmission_m",
    "since": "2026-11-21T08:15:30.120Z",
    "recording": "disagreement_X_20261121T081530Z.parquet",
}


class ConsistencyAnswer(Answer):
    """Consistency of the axis with its behaviour when it was learned."""

    model_config = ConfigDict(json_schema_extra={"examples": [_CONSISTENCY_EXAMPLE]})

    state: ConsistencyState
    ratio: dict[str, float] = Field(
        description="Mean squared innovation by channel, over that of ordinary motion."
    )
    channel: str | None = Field(description="Where they disagree most.")
    since: Timestamp | None = Field(validation_alias="since_time_ns")
    recording: str | None = Field(description="Trace of that moment, ready to diagnose.")


class DueAnswer(Answer):
    """Time by which a task is due: the interval in which its limit is reached."""

    earliest: Timestamp = Field(validation_alias="earliest_ns")
    likely: Timestamp | None = Field(validation_alias="likely_ns")
    latest: Timestamp | None = Field(validation_alias="latest_ns")


class AdviceAnswer(Answer):
    """One task for whoever works at the axis."""

    task: Task
    subject: Subject
    text: str
    now: bool = Field(description="Whether it is due now.")
    due: DueAnswer | None = Field(
        description="Date by which to do it if it is not due now; null if no date can be given."
    )
    together_with: list[Task] = Field(description="What else to do in the same stop.")


class PreloadFallAnswer(Answer):
    """Last sudden fall of the preload, percent of the fresh screw's, since a part was replaced."""

    from_percent: float
    to_percent: float
    time: Timestamp = Field(validation_alias="time_ns")


class HealthAnswer(Answer):
    """Condition of one axis, and the state of the data behind it."""

    axis: str
    condition: AxisCondition
    reasons: list[str] = Field(description="Why, as `code: sentence`.")
    since: Timestamp = Field(
        validation_alias="since_time_ns", description="When the condition was entered."
    )
    components: list[ComponentHealth]
    data_faults: dict[str, int] = Field(
        description="Faulty intervals per kind since the start.", examples=[{"gap": 2}]
    )
    alarms: list[AlarmAnswer] = Field(
        description="Alarms that a person should see, most serious first."
    )
    trend: TrendAnswer | None
    consistency: ConsistencyAnswer | None
    headline: Headline | None = Field(
        description="The one statement, from the worst of condition and alarms."
    )
    advice: list[AdviceAnswer] = Field(description="Tasks, the most urgent first.")
    fall: PreloadFallAnswer | None = Field(
        description="null if there has been none since the part came into use."
    )


class ServiceAnswer(Answer):
    """Health of the whole service."""

    time: Timestamp = Field(description="Time of this answer, by the clock of the service.")
    ready: bool
    reasons: list[str] = Field(description="Why the service is not ready, per axis.")
    version: str = Field(description="Version of edge-service.")
    configuration: str = Field(
        description="Digest of the configuration that it was started with; empty without a file."
    )
    components: list[ComponentHealth] = Field(description="Components that serve all axes.")
    axes: list[HealthAnswer]


WORST_FIRST = (
    AxisCondition.FAULT,
    AxisCondition.WARNING,
    AxisCondition.UNAVAILABLE,
    AxisCondition.NORMAL,
)


class AxisRow(Answer):
    """One axis in a list of many; numbers are null where nothing may be read."""

    axis: str
    condition: AxisCondition
    headline: Headline | None = None
    advice: list[AdviceAnswer] = Field([], description="Tasks, the most urgent first.")
    status: EstimateStatus
    method: str | None = Field(None, description="Estimator of the preload.")
    of_fresh: Interval | None = Field(
        None, description="Preload in percent of the fresh screw's, with its bounds."
    )
    measured_at: Timestamp | None = Field(
        None, description="Time of the newest sample behind it; null if there is none."
    )
    age_s: float | None = Field(None, description="Time since then, s.")
    next_limit: CrossingAnswer | None = Field(
        None, description="The first limit ahead for which there is a date."
    )
    rate_fresh_percent_per_h: Interval | None = Field(
        None, description="Change in percent of the fresh screw's preload per hour."
    )
    alarms: list[AlarmAnswer] = []
    limits: Limits | None = Field(None, description="null if the fresh preload is not known.")

    @property
    def urgency(self) -> tuple[int, str, float]:
        """Key to sort by, the worst first: condition, date of the next limit, preload."""
        limit = self.next_limit
        date = "" if limit is None else limit.likely or limit.earliest or ""
        percent = math.inf if self.of_fresh is None else self.of_fresh.value
        return WORST_FIRST.index(self.condition), date or "never", percent


class AxesAnswer(Answer):
    """All axes of one machine, the worst first."""

    site: str = Field(examples=["bench"])
    machine: str = Field(examples=["lfd"])
    axes: list[AxisRow]
    history: str = Field(description="Where and how long the history is kept.")


class BucketAnswer(Answer):
    """Summary of a span of time; numbers are null where there was no estimate."""

    time: Timestamp = Field(validation_alias="start_s", description="Start of the bucket.")
    samples: int = Field(description="Estimates kept inside, with or without a number.")
    estimated: int = Field(description="Those with a preload in percent.")
    status: EstimateStatus = Field(description="Status of the newest one.")
    preload_percent: Spread | None
    low: float | None = Field(description="Lowest lower bound, percent.")
    high: float | None = Field(description="Highest upper bound, percent.")
    drag_torque_nm: Spread | None
    nis: Spread | None = Field(description="Squared error of the model, 1 if it fits.")
    stiffness_n_per_m: Spread | None
    temperature_c: Spread | None


class HistoryAnswer(Answer):
    """History of one axis in buckets, oldest first; empty buckets are absent."""

    axis: str
    start: Timestamp = Field(alias="from")
    end: Timestamp = Field(alias="to")
    step_s: float = Field(description="Length of a bucket, s.")
    buckets: list[BucketAnswer]


class EventAnswer(Answer):
    """One event of an axis, or of the service (empty axis)."""

    axis: str
    kind: str = Field(examples=["condition_changed"])
    severity: Severity
    message: str
    time: Timestamp = Field(validation_alias="time_ns")
    who: str = Field("", description="Who asked for it; empty if nobody did.")
    origin: str = Field("", description="Address, `bus`, or a process of the service.")
    data: dict[str, str | float | int | None]
    sentence: Told = None


class NumberedEventAnswer(EventAnswer):
    """One event with the number under which the live stream knows it."""

    id: int


class ReadyAnswer(Answer):
    """The service can answer for every axis."""

    ready: bool = True


class AliveAnswer(Answer):
    """The process answers."""

    alive: bool = True
