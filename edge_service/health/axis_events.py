"""Events beyond those of an axis' condition and its alarms."""

from collections.abc import Mapping
from datetime import UTC, datetime

from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.health import Command
from .consistency import CHANNEL_WORDS, Disagreement
from .inputs import NS_PER_S

Data = Mapping[str, str | float | int | None]


def noted(
    axis: str,
    kind: str,
    words: Statement,
    now_ns: int,
    data: Data,
    level: AxisCondition = AxisCondition.NORMAL,
) -> Event:
    """Event in words that have a code; the text ends with the note of a person."""
    said = dict(words, text=f"{words.text}: {data['note']}") if data.get("note") else dict(words)
    return Event(axis=axis, kind=kind, level=level, time_ns=now_ns, data=dict(data), **said)


def preload_rose(axis: str, before: float, after: float, now_ns: int) -> Event:
    """Event of a rise that wear cannot make; preloads in percent of the fresh screw's."""
    words = told(Code.PRELOAD_ROSE, before=before, after=after)
    return noted(axis, "preload_rose", words, now_ns, {"from_percent": before, "to_percent": after})


def recording_name(axis: str, since_ns: int) -> str:
    """Name of the trace around a disagreement.

    >>> recording_name("X", 1_795_000_000_000_000_000)
    'disagreement_X_20261118T110640Z.parquet'
    """
    stamp = datetime.fromtimestamp(since_ns / NS_PER_S, UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"disagreement_{axis}_{stamp}.parquet"


def consistency_changed(axis: str, change: Disagreement, since_ns: int, now_ns: int) -> Event:
    """Event of a change of the verdict on the model."""
    watched = {"watched": CHANNEL_WORDS[change.channel]}
    data: Data = {"channel": change.channel, "ratio": change.ratio, "since_s": change.since_s}
    if not change.disagrees:
        words = told(Code.AXIS_AS_LEARNED, watched, watched=change.channel)
        return noted(axis, "model_agrees", words, now_ns, {**data, "recording": None})
    name = recording_name(axis, since_ns)
    words = told(Code.AXIS_DIFFERS, watched, watched=change.channel, recording=name)
    return noted(
        axis, "model_disagrees", words, now_ns, {**data, "recording": name}, AxisCondition.WARNING
    )


def recording_kept(axis: str, name: str, now_ns: int) -> Event:
    """Event of a recording that is ready to diagnose."""
    words = told(Code.DISAGREEMENT_RECORDED, recording=name)
    return noted(axis, "recording_kept", words, now_ns, {"recording": name})


def clock_changed(step_ns: int, now_ns: int) -> Event:
    """Event of a step of the clock, which all kept times have made as well."""
    seconds = step_ns / NS_PER_S
    way = "forward" if step_ns > 0 else "back"
    words = told(Code.CLOCK_SET_S, way=way, seconds=abs(seconds))
    if abs(seconds) >= 3600.0:
        words = told(Code.CLOCK_SET_H, way=way, hours=abs(seconds) / 3600.0)
    return noted("", "clock_changed", words, now_ns, {"step_s": seconds}, AxisCondition.WARNING)


def log_entry(axis: str, command: Command, now_ns: int) -> Event:
    """Event of a note, or of a part that was replaced."""
    own, data = Statement(text=f"{command.note} ({command.user})"), {"user": command.user}
    if command.action == "note":
        return noted(axis, "note", own, now_ns, data)
    words, data = told(Code.PART_REPLACED, user=command.user), {**data, "note": command.note}
    return noted(axis, "part_replaced", words, now_ns, data)


def refused_command(axis: str, command: Command, reason: str, now_ns: int) -> Event:
    """Event of a command that would have changed nothing."""
    action, alarm = command.action, command.alarm or ""
    words = told(Code.COMMAND_REFUSED, {"reason": reason}, command=action, alarm=alarm)
    event = noted(axis, "command", words, now_ns, {"action": action, "outcome": "refused"})
    return event.model_copy(update={"who": command.user, "origin": command.origin or "bus"})
