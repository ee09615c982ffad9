"""Data items of an axis in the words of MTConnect: what each is, and its value in an answer."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from ...messages.alarm import Alarm
from ...messages.answer import AxisAnswer
from ...messages.event import Severity

UNAVAILABLE = "UNAVAILABLE"
_CODE = "PRELOAD"
"""Native code of the condition: one, so that what comes replaces what was."""
_LEVELS = {Severity.INFO: "NORMAL", Severity.WARNING: "WARNING", Severity.ERROR: "FAULT"}
_HEALTH_MISSING = ("no_health:", "stale_health:")


@dataclass(frozen=True, slots=True)
class Item:
    """One data item; its name is followed by that of the axis.

    Attributes:
        kind: its type; with a prefix one that MTConnect does not have.
        read: fields of its value; None where there is none.
        units: of a number, in the words of MTConnect.
    """

    category: str
    kind: str
    read: Callable[[AxisAnswer], tuple[str, ...] | None]
    units: str = ""
    subtype: str = ""


def _of_fresh(name: str) -> Callable[[AxisAnswer], tuple[str, ...] | None]:
    def read(answer: AxisAnswer) -> tuple[str, ...] | None:
        interval = answer.of_fresh
        return None if interval is None else _number(getattr(interval, name))

    return read


def _force(answer: AxisAnswer) -> tuple[str, ...] | None:
    return _number(answer.estimate.preload_n)


def _drag(answer: AxisAnswer) -> tuple[str, ...] | None:
    drag = answer.estimate.drag_torque_nm
    return None if drag is None else _number(drag.value)


def _number(value: float | None) -> tuple[str, ...] | None:
    return None if value is None else (f"{value:.6g}",)


def _advice(answer: AxisAnswer) -> tuple[str, ...]:
    first = answer.advice
    if first is None:
        return "", ""
    due = "" if answer.due_ns is None else f" ({_day(answer.due_ns)})"
    return first.task.value, first.text + due


def _day(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d")


ITEMS: dict[str, Item] = {
    "preload": Item("SAMPLE", "x:PRELOAD", _of_fresh("value"), "PERCENT"),
    "preloadLow": Item("SAMPLE", "x:PRELOAD", _of_fresh("low"), "PERCENT", "x:LOW"),
    "preloadHigh": Item("SAMPLE", "x:PRELOAD", _of_fresh("high"), "PERCENT", "x:HIGH"),
    "preloadForce": Item("SAMPLE", "LINEAR_FORCE", _force, "NEWTON"),
    "dragTorque": Item("SAMPLE", "TORQUE", _drag, "NEWTON_METER"),
    "advice": Item("EVENT", "MESSAGE", _advice),
}
"""Samples and events of an axis by name; no name holds an underscore, which ends it."""
CONDITIONS = {"condition": "ACTUATOR", "alarms": "SYSTEM"}
"""Types of the conditions of an axis by name."""


def item_name(item: str, axis: str) -> str:
    """Name of a data item of an axis."""
    return f"{item}_{axis}"


def condition_of(answer: AxisAnswer) -> tuple[str, ...]:
    """Level, native code, native severity, qualifier and text of the axis' condition."""
    health = answer.health
    level = health.condition.value
    if level in (UNAVAILABLE, "NORMAL"):
        return level, "", "", "", ""
    text = "" if health.headline is None else health.headline.text
    return level, _CODE, "", "LOW", text


def alarms_of(answer: AxisAnswer) -> dict[str, tuple[str, ...]] | None:
    """Fields of each active alarm by its native code; None if they are not known."""
    if any(reason.startswith(_HEALTH_MISSING) for reason in answer.health.reasons):
        return None
    return {alarm.kind.value: _alarm(alarm) for alarm in answer.health.alarms if alarm.active}


def _alarm(alarm: Alarm) -> tuple[str, ...]:
    return _LEVELS[alarm.severity], alarm.kind.value, alarm.severity.value, "", alarm.message
