"""Changes that a bundle makes: file by file, key by key, old and new, secrets hidden."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal

from ...command_answer import Document
from .toml_text import HIDDEN, flat, is_secret

_UNITS = (
    ("_nm_s_per_rad", "N m s/rad"),
    ("_nm_per_rad", "N m/rad"),
    ("_n_per_m", "N/m"),
    ("_kg_m2", "kg m2"),
    ("_rad_s2", "rad/s2"),
    ("_rad_s", "rad/s"),
    ("_m_s2", "m/s2"),
    ("_m_s", "m/s"),
    ("_nm", "N m"),
    ("_kg", "kg"),
    ("_hz", "Hz"),
    ("_mb", "MB"),
    ("_rad", "rad"),
    ("_percent", "%"),
    ("_c", "degC"),
    ("_m", "m"),
    ("_n", "N"),
    ("_s", "s"),
    ("_h", "h"),
)
NONE = "(none)"


class ChangedKey(Document):
    """One key of a file that changes, as people read it; `(none)` where there is none."""

    key: str
    old: str
    new: str


class ChangedFile(Document):
    """One file that a bundle adds, changes or takes away; keys of a changed file."""

    name: str
    change: Literal["added", "changed", "removed"]
    keys: list[ChangedKey]
    needs_restart: bool


def changes(
    old: Mapping[str, bytes], new: Mapping[str, bytes], at_once: frozenset[str] = frozenset()
) -> list[ChangedFile]:
    """Changes from some files to others, in the order of their names.

    Args:
        old, new: content by name.
        at_once: names of files that the service does not read.
    """
    found = []
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) == new.get(name):
            continue
        keys = _keys(old.get(name, b""), new.get(name, b""), name)
        change: Literal["added", "changed", "removed"] = "changed"
        if name not in old or name not in new:
            change = "removed" if name in old else "added"
        restart = name not in at_once and bool(keys)
        found.append(ChangedFile(name=name, change=change, keys=keys, needs_restart=restart))
    return found


def _keys(old: bytes, new: bytes, name: str) -> list[ChangedKey]:
    before, after = flat(old, name), flat(new, name)
    return [
        ChangedKey(key=key, old=_shown(before, key), new=_shown(after, key))
        for key in {**before, **after}
        if key not in before or key not in after or before[key] != after[key]
    ]


def _shown(values: Mapping[str, Any], key: str) -> str:
    if key not in values:
        return NONE
    value = values[key]
    if is_secret(key, value):
        return HIDDEN
    unit = next((unit for end, unit in _UNITS if key.endswith(end)), "")
    if isinstance(value, dict):
        tolerance = value.get("tolerance")
        around = "" if tolerance is None else f" +- {100 * tolerance:g} %"
        return f"{_plain(value['value'])} {unit}".rstrip() + around
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{_plain(value)} {unit}".rstrip() if is_number else _plain(value)


def _plain(value: Any) -> str:
    """A value on one line, without characters that a terminal obeys."""
    text = json.dumps(value, default=str, ensure_ascii=False)
    return re.sub(r"[^\x20-\x7e\xa0-\uffff]", "?", text)


def change_lines(changed: list[ChangedFile]) -> Iterator[str]:
    """Lines for people."""
    for file in changed:
        if file.change == "changed" and not file.keys:
            yield f"{file.name}: comments or order only"
            continue
        yield f"{file.name}: {file.change}"
        yield from (f"  {each.key}: {each.old} -> {each.new}" for each in file.keys)
    restart = [file.name for file in changed if file.needs_restart]
    if not changed:
        yield "nothing changes"
    elif restart:
        yield f"restart the service for {', '.join(restart)}"
    else:
        yield "no restart is needed"
