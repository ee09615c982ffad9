"""JSON from anybody: parsed only where every part of it keeps within bounds.

What has passed holds finite numbers, integers of 64 bits, and texts and lists of limited length, so
that whoever reads it may count on that.
"""

import json
from typing import Any, NoReturn

LARGEST = 2**63 - 1
FURTHEST = 1e50
"""No measured or computed number lies beyond; its powers can still be computed with."""
MOST_DEPTH = 8
MOST_TEXT = 4096
"""Characters of one text."""
MOST_ENTRIES = 1024
"""Values in one list, or keys in one object."""


def parse_bounded(text: bytes) -> dict[str, Any]:
    """Members of a JSON object. Raises ValueError, RecursionError."""
    members = _DECODER.decode(text.decode())
    if not isinstance(members, dict):
        raise ValueError("no object")
    check_bounded(members)
    return members


def check_bounded(members: dict[str, Any]) -> None:
    """Raise ValueError if a part of what would be JSON is beyond the bounds."""
    _check(members, MOST_DEPTH)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number of JSON")


_DECODER = json.JSONDecoder(parse_constant=_refuse)


def _check(value: Any, depth: int) -> None:
    """Raise ValueError for whatever lies outside the bounds."""
    if isinstance(value, str):
        if len(value) > MOST_TEXT:
            raise ValueError(f"a text of more than {MOST_TEXT} characters")
        value.encode()  # a lone surrogate cannot be written anywhere
    elif isinstance(value, int):
        if abs(value) > LARGEST:
            raise ValueError("an integer of more than 64 bits")
    elif isinstance(value, float):
        if not abs(value) <= FURTHEST:  # 1e999 is infinite
            raise ValueError("a number beyond all bounds")
    elif value is not None:
        _check_entries(value, depth)


def _check_entries(value: list[Any] | dict[str, Any], depth: int) -> None:
    if depth == 0:
        raise ValueError(f"nested deeper than {MOST_DEPTH}")
    if len(value) > MOST_ENTRIES:
        raise ValueError(f"more than {MOST_ENTRIES} entries")
    for each in value.items() if isinstance(value, dict) else value:
        if isinstance(each, tuple):
            _check(each[0], depth)
            _check(each[1], depth - 1)
        else:
            _check(each, depth - 1)
