"""Lines of SHDR, the protocol between adapters and agents of MTConnect.

Source: Adapter Agent Protocol Version 2.0 (https://mtcup.org/Protocol); quoting as the agent
reads it (`ShdrTokenizer` of https://github.com/mtconnect/cppagent).
"""

import re
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from ...messages.answer import AxisAnswer
from .items import ITEMS, UNAVAILABLE, alarms_of, condition_of, item_name

_CONTROL = re.compile(r"[\x00-\x1f\x7f\x85\u2028\u2029]+")
_ESCAPED = re.compile(r'([\\|"])')
Values = dict[tuple[str, str], tuple[str, ...]]
"""Fields of data items, by name and, of a condition, native code."""
_NORMAL = ("NORMAL", "", "", "", "")
_UNKNOWN = (UNAVAILABLE, "", "", "", "")


def field(text: str) -> str:
    """Text as a field: on one line, quoted where it holds what would end or begin one."""
    plain = _CONTROL.sub(" ", text).strip()
    if "|" not in plain and not plain.startswith('"'):
        return plain
    return '"' + _ESCAPED.sub(r"\\\1", plain) + '"'


def values_of(answer: AxisAnswer) -> Values:
    """All that an answer says."""
    axis = answer.axis
    values: Values = {}
    for name, item in ITEMS.items():
        fields = item.read(answer) if answer.is_heard else None
        missing = ("", UNAVAILABLE) if item.kind == "MESSAGE" else (UNAVAILABLE,)
        values[item_name(name, axis), ""] = missing if fields is None else fields
    values[item_name("condition", axis), ""] = condition_of(answer)
    alarms = alarms_of(answer)
    name = item_name("alarms", axis)
    if not alarms:
        values[name, ""] = _UNKNOWN if alarms is None else _NORMAL
    return values | {(name, code): fields for code, fields in (alarms or {}).items()}


def changes(before: Values, after: Values) -> Values:
    """Lines that tell the changes to an agent that knows the values before."""
    told = {key: fields for key, fields in after.items() if before.get(key) != fields}
    for name, code in before.keys() - after.keys():
        if code and (name, "") not in after:  # another is active still, and this one is over
            told[name, code] = ("NORMAL", code, "", "", "")
    return told


def lines(values: Values, now_ns: int, measured_ns: int | None = None) -> Iterator[str]:
    """Lines without their ends: one for all numbers, one for each condition and message.

    Args:
        now_ns: UNIX time of what is judged, ns.
        measured_ns: of the newest sample behind the numbers, ns.
    """
    numbers = {name: fields for (name, _), fields in values.items() if len(fields) == 1}
    missing = {name: fields for name, fields in numbers.items() if fields == (UNAVAILABLE,)}
    known = {name: fields for name, fields in numbers.items() if name not in missing}
    for group, time_ns in ((missing, now_ns), (known, measured_ns or now_ns)):
        if group:
            pairs = (part for name, fields in group.items() for part in (name, *fields))
            yield _joined(timestamp(time_ns), pairs)
    for (name, _), fields in values.items():
        if len(fields) > 1:
            yield _joined(timestamp(now_ns), (name, *fields))


def timestamp(time_ns: int) -> str:
    """UNIX time as ISO 8601 in UTC."""
    moment = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{time_ns % 1_000_000_000 // 1000:06d}Z"


def _joined(moment: str, parts: Iterable[str]) -> str:
    return "|".join((moment, *(field(part) for part in parts)))
