"""One headline for each axis, and advice on what to do, by when, and what else in the same stop."""

from collections.abc import Iterable, Iterator, Sequence

from ..messages.answer import of_fresh as share_of_fresh
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.health import (
    Advice,
    AlarmKind,
    AxisHealth,
    Headline,
    Task,
)
from ..messages.interval import printed, rfc3339
from ..messages.trend import Crossing, Trend, TrendStatus
from .alarm_latch import clock

_CODES = {
    AxisCondition.NORMAL: Code.NORMAL,
    AxisCondition.WARNING: Code.WARNING,
    AxisCondition.FAULT: Code.FAULT,
}
_IN_DOUBT = {
    AxisCondition.WARNING: Code.MAY_BE_WARNING,
    AxisCondition.FAULT: Code.MAY_BE_FAULT,
}
_CODE_OF_REASON = {
    "preparing": Code.STARTING,
    "learning": Code.LEARNING,
    "confirming": Code.LEARNING,
    "no_input": Code.NO_DATA_YET,
    "no_data": Code.NO_DATA_YET,
    "no_health": Code.NO_DATA_YET,
    "stale_input": Code.NO_DATA_SINCE,
    "stale_health": Code.NO_DATA_SINCE,
    "no_motion": Code.NOT_MOVED,
    "insufficient_excitation": Code.NOT_MOVED,
    "process_force": Code.ONLY_UNDER_LOAD,
    "model_mismatch": Code.MODEL_DISAGREES,
    "no_limit": Code.MACHINE_FILE_LACKS,
    "no_percent": Code.MACHINE_FILE_LACKS,
    "too_slow": Code.TOO_SLOW,
}
_CODE_OF_STATUS = {
    EstimateStatus.INSUFFICIENT_EXCITATION: Code.NOT_MOVED,
    EstimateStatus.INVALID: Code.MODEL_DISAGREES,
}
_LACKING = {"no_limit": "fresh preload", "no_percent": "load rating"}
_SENSORS = {"torque": "torque", "angle": "motor angle", "table": "linear encoder"}


def headline(health: AxisHealth) -> Headline:
    """Headline of an axis; where condition and alarm are as grave, the condition speaks."""
    own = Headline(level=health.condition, **dict(_of_condition(health)))
    alarms = [
        Headline(level=alarm.level, code=alarm.code, text=_capital(alarm.text), values=alarm.values)
        for alarm in health.alarms
        if alarm.active
    ]
    return max((own, *alarms), key=lambda each: each.level.urgency)


def _of_condition(health: AxisHealth) -> Statement:
    if health.condition is AxisCondition.UNAVAILABLE:
        return _unavailable(health)
    codes = _CODES | (_IN_DOUBT if health.is_in_doubt else {})
    shown = health.of_fresh
    if shown is None:
        words = told(codes[health.condition], value=0.0, low=0.0, high=0.0)
        return Statement(code=words.code, text=words.text.partition(":")[0] + ".")
    value, low, high = map(float, printed(shown.value, shown.low, shown.high))
    return told(codes[health.condition], value=value, low=low, high=high)


def _unavailable(health: AxisHealth) -> Statement:
    """Statement on a number that is missing, by the first reason."""
    reasons = [each.partition(": ") for each in health.reasons or ("no_input: ",)]
    own = [each for each in reasons if each[0] != "no_number"] or reasons
    reason, _, sentence = own[0]
    code = _CODE_OF_REASON.get(reason)
    if code is Code.MACHINE_FILE_LACKS:
        return told(code, {"missing": _LACKING[reason]}, missing=reason)
    sensor = reason.partition("_")[0]
    if sensor in _SENSORS:
        words = {"sensor": f"The {_SENSORS[sensor]}", "reason": sentence}
        return told(Code.SENSOR_FAULTY, words, sensor=sensor, reason=reason)
    code = code or _CODE_OF_STATUS.get(health.status)
    if code is None:
        return told(Code.NOT_KNOWN, {"reason": sentence.rstrip(".")}, reason=reason)
    since_ns = health.since_time_ns
    if code is Code.NO_DATA_SINCE:
        since_ns = health.measured_time_ns or since_ns
    if code in (Code.NO_DATA_SINCE, Code.NOT_MOVED, Code.ONLY_UNDER_LOAD):
        return told(code, {"time": clock(since_ns)}, time=rfc3339(since_ns))
    return told(code)


def _capital(text: str) -> str:
    end = "" if text.endswith((".", "?", "!")) else "."
    return text[:1].upper() + text[1:] + end


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
    Task.FIND_CHANGE: (
        "Find out what changed: a new part, other grease, a repair? If a part was replaced, "
        "note “part replaced”."
    ),
    Task.CHECK_SERVICE: "Look at the parts of the service: one of them does not work.",
    Task.CHECK_CONNECTION: "Check the connection to the drive: no data are coming in.",
    Task.SWITCH_ON: "Check that the drive is on and connected: no data have come in yet.",
    Task.COMPLETE_MACHINE_FILE: (
        "Complete the machine file: the fresh screw's preload or the load rating is missing."
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
_BY_REASON = {
    "preparing": Task.WAIT,
    "process_force": Task.MOVE_FREELY,
    "no_motion": Task.MOVE,
    "too_slow": Task.COMMISSION_SOURCE,
    "learning": Task.WAIT,
    "insufficient_excitation": Task.MOVE,
    "stale_input": Task.CHECK_CONNECTION,
    "no_input": Task.SWITCH_ON,
    "no_data": Task.CHECK_CONNECTION,
    "stale_health": Task.CHECK_SERVICE,
    "no_health": Task.CHECK_SERVICE,
    "no_limit": Task.COMPLETE_MACHINE_FILE,
    "confirming": Task.WAIT,
}
_NUT = (Task.REPLACE_NUT, Task.PLAN_NUT)


def advice(health: AxisHealth, estimate: PreloadEstimate | None) -> tuple[Advice, ...]:
    """Tasks of an axis, the most urgent first; empty if there is nothing to do."""
    tasks = list(dict.fromkeys(_tasks(health, estimate)))
    return tuple(_advice(task, tasks, health) for task in tasks)


def _tasks(health: AxisHealth, estimate: PreloadEstimate | None) -> Iterator[Task]:
    active = {alarm.kind for alarm in health.alarms if alarm.active}
    doubt = AlarmKind.MODEL in active or _status(estimate) is EstimateStatus.INVALID
    if AlarmKind.SUDDEN_DROP in active:
        yield Task.INSPECT
    if doubt:
        yield Task.DIAGNOSE
    yield from _of_preload(health, active, doubt or health.is_in_doubt)
    if AlarmKind.RATE in active:
        yield Task.FIND_WEAR
    if _wants_grease(estimate):
        yield Task.REGREASE
    if health.trend is not None and health.trend.status is TrendStatus.RISING:
        yield Task.FIND_CHANGE
    if AlarmKind.SERVICE in active:
        yield Task.CHECK_SERVICE
    if health.condition is AxisCondition.UNAVAILABLE:
        yield _for_a_number(health, estimate)
    elif AlarmKind.DATA_LOST in active:
        yield Task.WAIT
    if any(alarm.acknowledged_by is None for alarm in health.alarms):
        yield Task.ACKNOWLEDGE


def _of_preload(health: AxisHealth, active: set[AlarmKind], doubt: bool) -> Iterator[Task]:
    lost = health.condition is AxisCondition.FAULT or AlarmKind.PRELOAD_LOST in active
    low = health.condition is AxisCondition.WARNING or AlarmKind.PRELOAD_LOW in active
    if (lost or low) and doubt:
        yield Task.CONFIRM_LOSS
    elif lost:
        yield Task.REPLACE_NUT
    elif low or AlarmKind.RATE in active:
        yield Task.PLAN_NUT


def _for_a_number(health: AxisHealth, estimate: PreloadEstimate | None) -> Task:
    reasons = (*health.reasons, *(() if estimate is None else estimate.reasons))
    codes = [reason.partition(":")[0] for reason in reasons]
    if _status(estimate) is EstimateStatus.INSUFFICIENT_EXCITATION:
        codes.append("insufficient_excitation")
    return next((task for code, task in _BY_REASON.items() if code in codes), Task.WAIT)


def _status(estimate: PreloadEstimate | None) -> EstimateStatus | None:
    return None if estimate is None else estimate.status


def _wants_grease(estimate: PreloadEstimate | None) -> bool:
    known = {} if estimate is None else estimate.fault_probability
    return known.get("lubrication", 0.0) >= LIKELY_GREASE


def _advice(task: Task, tasks: Sequence[Task], health: AxisHealth) -> Advice:
    later = task is Task.PLAN_NUT
    return Advice(
        task=task,
        text=TEXTS[task],
        now=not later,
        due=_due(health.trend) if later else None,
        together_with=(Task.REGREASE,) if task in _NUT and Task.REGREASE in tasks else (),
    )


def _due(trend: Trend | None) -> Crossing | None:
    crossings = () if trend is None else trend.crossings
    fault = next((each for each in crossings if each.limit == "fault"), None)
    return None if fault is None or fault.earliest_ns is None else fault


_PASSED = {
    AxisCondition.WARNING: frozenset({"warning"}),
    AxisCondition.FAULT: frozenset({"warning", "fault"}),
}


def consistent(health: AxisHealth, estimate: PreloadEstimate | None) -> AxisHealth:
    """Return the health with number and trend that fit its condition, headline and advice."""
    trend, number = _ahead(health.trend, health.condition), None
    if estimate is not None and health.condition is not AxisCondition.UNAVAILABLE:
        fresh = None if health.limits is None else health.limits.fresh_percent
        number = share_of_fresh(estimate, fresh)
    dated = (each for each in (trend.crossings if trend else ()) if each.earliest_ns is not None)
    told = health.model_copy(
        update={"trend": trend, "of_fresh": number, "next_limit": next(dated, None)}
    )
    return told.model_copy(update={"headline": headline(told), "advice": advice(told, estimate)})


def of_fresh(trend: Trend, fresh_percent: float | None) -> Trend:
    """Return the trend with its rate in percent of the fresh screw's preload as well."""
    rate = trend.rate_percent_per_h
    if rate is None or not fresh_percent:
        return trend
    return trend.model_copy(update={"rate_fresh_percent_per_h": rate.times(100.0 / fresh_percent)})


def _ahead(trend: Trend | None, condition: AxisCondition) -> Trend | None:
    """Return the trend without dates for limits that the axis has passed already."""
    passed = _PASSED.get(condition, frozenset())
    if trend is None or not any(each.limit in passed for each in trend.crossings):
        return trend
    crossings = tuple(each for each in trend.crossings if each.limit not in passed)
    return trend.model_copy(update={"crossings": crossings})


def announced(events: Iterable[Event], health: AxisHealth) -> tuple[Event, ...]:
    """Return the events; those of alarms and condition with the headline's code and first task."""
    return tuple(_with_advice(event, health) if _calls(event) else event for event in events)


def _calls(event: Event) -> bool:
    return event.kind == "condition_changed" or event.kind.startswith("alarm_")


def _with_advice(event: Event, health: AxisHealth) -> Event:
    headline = None if health.headline is None else health.headline.code
    task = health.advice[0].task.value if health.advice else None
    return event.model_copy(update={"data": event.data | {"headline": headline, "task": task}})
