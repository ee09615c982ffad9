"""Statements on an answer: `effects[name=backlash].probability` below 0.5."""

import json
import math
import re
import textwrap
from collections.abc import Callable
from typing import Any

from .case_file import Assertion

STEP = re.compile(r"(?P<key>[^.\[\]]+)|\[(?P<name>\w+)=(?P<value>[^\]]*)\]|\[(?P<index>\*|-?\d+)\]")


def values_at(answer: Any, path: str) -> list[Any]:
    """Values at a path: keys with dots between, `[*]`, `[0]`, `[name=value]`; `$` is all of it."""
    values = [answer]
    path = path.removeprefix("$")
    for step in STEP.finditer(path):
        values = [found for value in values for found in _one_step(value, step)]
    return values


def _one_step(value: Any, step: re.Match[str]) -> list[Any]:
    if step["key"] is not None:
        return [value[step["key"]]] if isinstance(value, dict) and step["key"] in value else []
    if not isinstance(value, list):
        return []
    if step["name"] is not None:
        return [each for each in value if str(each.get(step["name"])) == step["value"]]
    if step["index"] == "*":
        return value
    return value[int(step["index"]) :][:1]


def assert_holds(assertion: Assertion, answer: Any) -> None:
    """Hold an assertion against every value at its path."""
    values = values_at(answer, assertion.path)
    if assertion.absent:
        assert not values, f"{assertion.path}: {shown(values)} is there"
        return
    assert values or assertion.if_present, f"{assertion.path}: not in the answer"
    for value in values:
        for kind in sorted(assertion.model_fields_set - {"path", "if_present", "absent"}):
            wanted = getattr(assertion, kind)
            assert KINDS[kind](value, wanted), (
                f"{assertion.path}: {kind} {wanted!r}, but {shown(value)}"
            )


def shown(value: Any) -> str:
    return textwrap.shorten(json.dumps(value), 200)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


KINDS: dict[str, Callable[[Any, Any], bool]] = {
    "equals": lambda value, wanted: bool(value == wanted),
    "below": lambda value, wanted: _is_number(value) and value < wanted,
    "above": lambda value, wanted: _is_number(value) and value > wanted,
    "one_of": lambda value, wanted: value in wanted,
    "none_of": lambda value, wanted: value not in wanted,
    "contains": lambda value, wanted: wanted in value,
    "mentions": lambda value, wanted: wanted in json.dumps(value).lower(),
}
