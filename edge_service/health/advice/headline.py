"""Headline of an axis: the worst of its condition and its active alarms."""

from ...messages.advice import Headline, Level
from ...messages.alarm import Alarm, AlarmKind
from ...messages.health import AxisCondition, AxisHealth

_OF_CONDITION = {
    AxisCondition.NORMAL: Level.OK,
    AxisCondition.WARNING: Level.ATTENTION,
    AxisCondition.FAULT: Level.ACT,
    AxisCondition.UNAVAILABLE: Level.UNKNOWN,
}
_OF_ALARM = dict.fromkeys(AlarmKind, Level.ATTENTION) | {
    AlarmKind.PRELOAD_LOST: Level.ACT,
    AlarmKind.SUDDEN_DROP: Level.ACT,
    AlarmKind.DATA_LOST: Level.UNKNOWN,
}
_RANK = list(Level)
_TEXTS = {
    AxisCondition.NORMAL: "The preload is within its limits",
    AxisCondition.WARNING: "The preload is low",
    AxisCondition.FAULT: "The preload is lost, or nearly so",
    AxisCondition.UNAVAILABLE: "The preload is not known at present",
}
_TEXTS_IN_DOUBT = {
    AxisCondition.WARNING: "The preload is low, or looks so",
    AxisCondition.FAULT: "The preload is lost, or looks so",
}


def headline(health: AxisHealth) -> Headline:
    """Headline of an axis; where condition and alarm are as grave, the condition speaks."""
    condition = health.condition
    texts = _TEXTS | (_TEXTS_IN_DOUBT if health.is_in_doubt else {})
    own = Headline(
        level=_OF_CONDITION[condition], code=condition.value.lower(), text=texts[condition] + "."
    )
    alarms = [_of_alarm(alarm) for alarm in health.alarms if alarm.active]
    return max((own, *alarms), key=lambda each: _RANK.index(each.level))


def _of_alarm(alarm: Alarm) -> Headline:
    text = alarm.message[:1].upper() + alarm.message[1:]
    end = "" if text.endswith((".", "?", "!")) else "."
    return Headline(level=_OF_ALARM[alarm.kind], code=alarm.kind.value, text=text + end)
