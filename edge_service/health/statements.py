"""Statements on an axis: its headline, from condition and alarms; what to do, and by when."""

import re
from collections.abc import Iterator
from datetime import datetime

from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition, Code, Statement, told
from ..messages.health import Advice, AlarmKind, AxisHealth, Headline, Task
from ..messages.interval import printed, rfc3339
from ..messages.trend import TrendStatus

_CODES = {
    AxisCondition.NORMAL: (Code.NORMAL, Code.NORMAL),
    AxisCondition.WARNING: (Code.WARNING, Code.MAY_BE_WARNING),
    AxisCondition.FAULT: (Code.FAULT, Code.MAY_BE_FAULT),
}
REASONS: dict[str, tuple[Code, Task | None]] = {
    "preparing": (Code.STARTING, Task.WAIT),
    "process_force": (Code.ONLY_UNDER_LOAD, Task.MOVE_FREELY),
    "no_motion": (Code.NOT_MOVED, Task.MOVE),
    "too_slow": (Code.TOO_SLOW, Task.COMMISSION_SOURCE),
    "learning": (Code.LEARNING, Task.WAIT),
    "insufficient_excitation": (Code.NOT_MOVED, Task.MOVE),
    "stale_input": (Code.NO_DATA_SINCE, Task.CHECK_CONNECTION),
    "no_input": (Code.NO_DATA_YET, Task.SWITCH_ON),
    "no_data": (Code.NO_DATA_YET, Task.CHECK_CONNECTION),
    "stale_health": (Code.NO_DATA_SINCE, Task.CHECK_SERVICE),
    "no_health": (Code.STARTING, Task.CHECK_SERVICE),
    "no_limit": (Code.MACHINE_FILE_LACKS, Task.COMPLETE_MACHINE_FILE),
    "no_percent": (Code.MACHINE_FILE_LACKS, Task.COMPLETE_MACHINE_FILE),
    "confirming": (Code.LEARNING, Task.WAIT),
    "model_mismatch": (Code.MODEL_DISAGREES, None),
}
"""Sentence and task of each reason for which there is no number; the first task counts."""
_CODE_OF_STATUS = {
    EstimateStatus.INSUFFICIENT_EXCITATION: Code.NOT_MOVED,
    EstimateStatus.INVALID: Code.MODEL_DISAGREES,
}
_BELOW = re.compile(r"^(?:may_be_)?(below_\w+: the preload) (?:is|may be)")
_LACKING = {"no_limit": "the fresh preload", "no_percent": "what preload in % needs"}
_SENSORS = {"torque": "torque", "angle": "motor angle", "table": "linear encoder"}
LIKELY_GREASE = 0.9
"""Probability of more friction at the same preload from which regreasing is advised."""
TEXTS = {
    Task.INSPECT: "Stop the axis and look for damage: nut, balls, bearings, coupling.",
    Task.REPLACE_NUT: (
        "Replace or readjust the nut, then note “part replaced”. Until then expect backlash "
        "and scrap."
    ),
    Task.CONFIRM_LOSS: "Confirm the loss of preload by a test before you replace the nut.",
    Task.PLAN_NUT: "Plan to replace or readjust the nut.",
    Task.FIND_WEAR: "Find out why the screw wears fast: load, lubrication, dirt.",
    Task.DIAGNOSE: (
        "Do not rely on the number yet. Check sensors and machine file; if they are right, "
        "record a test and run a diagnosis."
    ),
    Task.REGREASE: "Regrease the screw: its friction has risen, not its preload.",
    Task.TEST: "Run the test by shaking (under Tests): the last is old, or friction has changed.",
    Task.FIND_CHANGE: (
        "Find out what changed: a new part, other grease, a repair? If a part was replaced, "
        "note “part replaced”."
    ),
    Task.CHECK_SERVICE: "Look at the parts of the service: one of them does not work.",
    Task.CHECK_CONNECTION: "Check the connection to the drive: no data are coming in.",
    Task.SWITCH_ON: "Check that the drive is on and connected: no data have come in yet.",
    Task.COMPLETE_MACHINE_FILE: (
        "Complete the machine file from the data sheets: the reason says what is missing."
    ),
    Task.COMMISSION_SOURCE: (
        "Commission the axis from recordings of this source: its samples are slower than those of "
        "the commissioning."
    ),
    Task.MOVE_FREELY: "Let the axis move without cutting for a few seconds, such as a warm-up.",
    Task.MOVE: "Move the axis: its preload cannot be measured at rest.",
    Task.WAIT: "Wait a moment, and let the axis go on moving.",
    Task.ACKNOWLEDGE: "Acknowledge the alarm once you have taken note.",
}
"""Words of each task; those of the page are the same."""
_PASSED = {AxisCondition.WARNING: ("warning",), AxisCondition.FAULT: ("warning", "fault")}


def clock(time_ns: int) -> str:
    """Time of day in this computer's zone, with the date."""
    return f"{datetime.fromtimestamp(time_ns / 1e9).astimezone():%H:%M on %Y-%m-%d}"


def span(since_ns: int, until_ns: int) -> dict[str, str]:
    """Beginning and end of something, as times of day; `since` and `until`."""
    begun, ended = (datetime.fromtimestamp(at / 1e9).astimezone() for at in (since_ns, until_ns))
    date = "" if begun.date() == ended.date() else f" on {begun:%Y-%m-%d}"
    return {"since": f"{begun:%H:%M:%S}{date}", "until": f"{ended:%H:%M:%S on %Y-%m-%d}"}


def headline(health: AxisHealth) -> Headline:
    """Headline of an axis; where condition and alarm are as grave, the condition speaks."""
    own = Headline(level=health.condition, **dict(condition_words(health)))
    alarms = [
        Headline(level=alarm.level, code=alarm.code, text=alarm.text, values=alarm.values)
        for alarm in health.alarms
        if alarm.active
    ]
    return max((own, *alarms), key=lambda each: each.level.urgency)


def is_in_doubt(health: AxisHealth) -> bool:
    """The preload may as well be above the limit that the condition rests on."""
    if health.condition not in (AxisCondition.WARNING, AxisCondition.FAULT):
        return False
    limits, number = health.limits, health.of_fresh
    if limits is None or number is None:
        return any(reason.startswith("may_be_below") for reason in health.reasons)
    is_fault = health.condition is AxisCondition.FAULT
    limit = limits.fault_percent if is_fault else limits.warning_percent
    return number.high >= 100.0 * limit / limits.fresh_percent


def condition_words(health: AxisHealth) -> Statement:
    """Statement on the condition, with its number where there is one."""
    if health.condition is AxisCondition.UNAVAILABLE:
        return _unavailable(health)
    code = _CODES[health.condition][is_in_doubt(health)]
    if health.of_fresh is None:
        words = told(code, value=0.0, low=0.0, high=0.0)
        return Statement(code=words.code, text=words.text.partition(":")[0] + ".")
    number = health.of_fresh
    value, low, high = map(float, printed(number.value, number.low, number.high))
    return told(code, value=value, low=low, high=high)


def limit_words(health: AxisHealth, before: Statement) -> Statement:
    """Statement on the preload against its limits; without a number, that of before and so said."""
    if health.condition is AxisCondition.UNAVAILABLE or health.of_fresh is None:
        value = before.values.get("value")
        return before if value is None else told(Code.PRELOAD_LAST_KNOWN, value=float(value))
    words = condition_words(health)
    if health.condition is AxisCondition.NORMAL:
        return told(Code.PRELOAD_BACK, value=words.values["value"])
    return words


def because(code: Code, why: str, **values: str) -> Statement:
    """Statement of a code that names a reason, `code: sentence`."""
    reason, _, sentence = why.partition(": ")
    return told(code, {"reason": sentence.rstrip(".")}, reason=reason, **values)


def _unavailable(health: AxisHealth) -> Statement:
    reasons = health.reasons or ("no_input: ",)
    why = next((each for each in reasons if not each.startswith("no_number: ")), reasons[0])
    reason, _, sentence = why.partition(": ")
    code = REASONS.get(reason, (None, None))[0]
    if code is Code.MACHINE_FILE_LACKS:
        return told(code, {"missing": _LACKING[reason]}, missing=reason)
    sensor = reason.partition("_")[0]
    if sensor in _SENSORS:
        words = {"sensor": f"The {_SENSORS[sensor]}", "reason": sentence}
        return told(Code.SENSOR_FAULTY, words, sensor=sensor, reason=reason)
    code = code or _CODE_OF_STATUS.get(health.status)
    if code is None:
        return because(Code.NOT_KNOWN, why)
    if code not in (Code.NO_DATA_SINCE, Code.NOT_MOVED, Code.ONLY_UNDER_LOAD):
        return told(code)
    heard_ns = health.measured_time_ns if code is Code.NO_DATA_SINCE else None
    since_ns = heard_ns or health.since_time_ns
    return told(code, {"time": clock(since_ns)}, time=rfc3339(since_ns))


def advice(health: AxisHealth, estimate: PreloadEstimate | None) -> tuple[Advice, ...]:
    """Tasks of an axis, the most urgent first; empty if there is nothing to do."""
    tasks = list(dict.fromkeys(_tasks(health, estimate)))
    crossings = () if health.trend is None else health.trend.crossings
    due = next((each for each in crossings if each.limit == "fault" and each.earliest_ns), None)
    greases = (Task.REGREASE,) if Task.REGREASE in tasks else ()
    return tuple(
        Advice(
            task=task,
            text=TEXTS[task],
            now=task is not Task.PLAN_NUT,
            due=due if task is Task.PLAN_NUT else None,
            together_with=greases if task in (Task.REPLACE_NUT, Task.PLAN_NUT) else (),
        )
        for task in tasks
    )


def _tasks(health: AxisHealth, estimate: PreloadEstimate | None) -> Iterator[Task]:
    active = {alarm.kind for alarm in health.alarms if alarm.active}
    unknown, status = health.condition is AxisCondition.UNAVAILABLE, estimate and estimate.status
    doubt = AlarmKind.MODEL in active or (unknown and status is EstimateStatus.INVALID)
    if AlarmKind.SUDDEN_DROP in active:
        yield Task.INSPECT
    if doubt:
        yield Task.DIAGNOSE
    lost = health.condition is AxisCondition.FAULT or AlarmKind.PRELOAD_LOST in active
    low = health.condition is AxisCondition.WARNING or AlarmKind.PRELOAD_LOW in active
    if (lost or low) and (doubt or is_in_doubt(health)):
        yield Task.CONFIRM_LOSS
    elif lost:
        yield Task.REPLACE_NUT
    elif low or AlarmKind.RATE in active:
        yield Task.PLAN_NUT
    if AlarmKind.RATE in active:
        yield Task.FIND_WEAR
    likely, said = (estimate.fault_probability, estimate.reasons) if estimate else ({}, ())
    if status is EstimateStatus.ESTIMATED and likely.get("lubrication", 0.0) >= LIKELY_GREASE:
        yield Task.REGREASE
    yield from (Task.TEST for reason in said if reason.startswith("test_due:"))
    if health.trend is not None and health.trend.status is TrendStatus.RISING:
        yield Task.FIND_CHANGE
    if AlarmKind.SERVICE in active:
        yield Task.CHECK_SERVICE
    if unknown:
        yield _for_a_number(health, estimate)
    elif AlarmKind.DATA_LOST in active:
        yield Task.WAIT
    if any(alarm.acknowledged_by is None for alarm in health.alarms):
        yield Task.ACKNOWLEDGE


def _for_a_number(health: AxisHealth, estimate: PreloadEstimate | None) -> Task:
    reasons = (*health.reasons, *(() if estimate is None else estimate.reasons))
    codes = [reason.partition(":")[0] for reason in reasons]
    if estimate and estimate.status is EstimateStatus.INSUFFICIENT_EXCITATION:
        codes.append("insufficient_excitation")
    tasks = (task for code, (_, task) in REASONS.items() if task and code in codes)
    return next(tasks, Task.WAIT)


def consistent(health: AxisHealth, estimate: PreloadEstimate | None) -> AxisHealth:
    """Return the health with all that is said of its condition and number as they are now.

    Limits that the axis has passed already have no date.
    """
    passed = _PASSED.get(health.condition, ())
    trend = health.trend
    if trend is not None:
        ahead = tuple(each for each in trend.crossings if each.limit not in passed)
        trend = trend.model_copy(update={"crossings": ahead})
    dated = (each for each in (trend.crossings if trend else ()) if each.earliest_ns is not None)
    limit = r"may_be_\1 may be" if is_in_doubt(health) else r"\1 is"
    reasons = tuple(_BELOW.sub(limit, each) for each in health.reasons)
    now = {"trend": trend, "next_limit": next(dated, None), "reasons": reasons}
    alarms = tuple(
        alarm.model_copy(update=dict(limit_words(health, alarm)))
        if alarm.active and alarm.kind in (AlarmKind.PRELOAD_LOW, AlarmKind.PRELOAD_LOST)
        else alarm
        for alarm in health.alarms
    )
    told = health.model_copy(update={**now, "alarms": alarms})
    return told.model_copy(update={"headline": headline(told), "advice": advice(told, estimate)})
