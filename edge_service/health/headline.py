"""Statements on the preload of an axis, and the headline from the worst of condition and alarms."""

from datetime import datetime

from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition, Code, Statement, told
from ..messages.health import Alarm, AlarmKind, AxisHealth, Headline, Task
from ..messages.interval import printed, rfc3339

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
    "no_health": (Code.NO_DATA_YET, Task.CHECK_SERVICE),
    "no_limit": (Code.MACHINE_FILE_LACKS, Task.COMPLETE_MACHINE_FILE),
    "no_percent": (Code.MACHINE_FILE_LACKS, None),
    "confirming": (Code.LEARNING, Task.WAIT),
    "model_mismatch": (Code.MODEL_DISAGREES, None),
}
"""Sentence and task of each reason for which there is no number; the first task counts."""
_CODE_OF_STATUS = {
    EstimateStatus.INSUFFICIENT_EXCITATION: Code.NOT_MOVED,
    EstimateStatus.INVALID: Code.MODEL_DISAGREES,
}
_WITH_A_TIME = (Code.NO_DATA_SINCE, Code.NOT_MOVED, Code.ONLY_UNDER_LOAD)
_LACKING = {"no_limit": "fresh preload", "no_percent": "load rating"}
_SENSORS = {"torque": "torque", "angle": "motor angle", "table": "linear encoder"}


def clock(time_ns: int) -> str:
    """Time of day in this computer's zone, with the date."""
    return f"{datetime.fromtimestamp(time_ns / 1e9).astimezone():%H:%M on %Y-%m-%d}"


def span(since_ns: int, until_ns: int) -> dict[str, str]:
    """Beginning and end of something, as times of day; `since` and `until`."""
    begun, ended = (
        datetime.fromtimestamp(each / 1e9).astimezone() for each in (since_ns, until_ns)
    )
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


def as_of_now(health: AxisHealth) -> tuple[Alarm, ...]:
    """Alarms of an axis, those of the preload with the number that the health carries."""
    return tuple(
        alarm.model_copy(update=dict(limit_words(health, alarm)))
        if alarm.active and alarm.kind in (AlarmKind.PRELOAD_LOW, AlarmKind.PRELOAD_LOST)
        else alarm
        for alarm in health.alarms
    )


def _unavailable(health: AxisHealth) -> Statement:
    reasons = [each.partition(": ") for each in health.reasons or ("no_input: ",)]
    own = [each for each in reasons if each[0] != "no_number"] or reasons
    reason, _, sentence = own[0]
    code = REASONS.get(reason, (None, None))[0]
    if code is Code.MACHINE_FILE_LACKS:
        return told(code, {"missing": _LACKING[reason]}, missing=reason)
    sensor = reason.partition("_")[0]
    if sensor in _SENSORS:
        words = {"sensor": f"The {_SENSORS[sensor]}", "reason": sentence}
        return told(Code.SENSOR_FAULTY, words, sensor=sensor, reason=reason)
    code = code or _CODE_OF_STATUS.get(health.status)
    if code is None:
        return told(Code.NOT_KNOWN, {"reason": sentence.rstrip(".")}, reason=reason)
    if code not in _WITH_A_TIME:
        return told(code)
    since_ns = health.since_time_ns
    if code is Code.NO_DATA_SINCE:
        since_ns = health.measured_time_ns or since_ns
    return told(code, {"time": clock(since_ns)}, time=rfc3339(since_ns))
