"""Places in a JSON document: `data.torque`, `values.*.torque`, `vals.id=101.val`.

Between dots stands the name of a member; `*` is every element of a list, and `name=text` are those
elements whose member `name` is that text or number.
"""

from typing import Any

from .payload import MessageError

EVERY = "*"
_DEEPEST = 32


def check_member(member: str) -> str:
    """The place itself. Raises ValueError if it is none."""
    parts = member.split(".")
    if not all(parts) or len(parts) > _DEEPEST:
        raise ValueError(f"{member!r}: expected names with dots between, such as data.torque")
    return member


def values_at(document: Any, member: str) -> list[Any]:
    """Values at a place: the elements of a list, or the only one; none where nothing is there."""
    found = [document]
    for part in member.split("."):
        found = [value for each in found for value in _step(each, part)]
    if len(found) == 1 and isinstance(found[0], list):
        return found[0]
    return found


def number(value: Any) -> float:
    """A value as a number; NaN for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return float("nan")
    try:
        return float(value)
    except (ValueError, OverflowError):
        return float("nan")


def _step(document: Any, part: str) -> list[Any]:
    if isinstance(document, dict):
        return [document[part]] if part in document else []
    if not isinstance(document, list):
        return []
    name, equals, text = part.partition("=")
    if equals:
        return [e for e in document if isinstance(e, dict) and str(e.get(name)) == text]
    if part != EVERY:
        raise MessageError(f"a list where {part!r} is expected")
    return document
