"""Changes that a bundle makes: file by file, key by key, old and new, secrets hidden."""

import json
import re
from collections.abc import Iterator, Mapping
from itertools import takewhile
from operator import eq
from typing import Any, Literal

from ..document import Document
from .toml_text import HIDDEN, flat, is_secret

_UNITS = {
    "nm": "N m",
    "n": "N",
    "m": "m",
    "rad": "rad",
    "s": "s",
    "h": "h",
    "kg": "kg",
    "hz": "Hz",
    "mb": "MB",
    "c": "degC",
    "percent": "%",
    "m_s": "m/s",
    "m_s2": "m/s2",
    "rad_s": "rad/s",
    "rad_s2": "rad/s2",
    "kg_m2": "kg m2",
    "n_per_m": "N/m",
    "n_s_per_m": "N s/m",
    "nm_per_rad": "N m/rad",
    "nm_s_per_rad": "N m s/rad",
}
_OF_UNITS = {"per", "kg"} | {f"{unit}{power}" for unit in _UNITS for power in ("", "2", "3")}
"""Parts of names that belong to a unit."""
_MOST_SHOWN = 8
"""Entries of a list that are shown one by one."""
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
        ChangedKey(key=key, old=_shown(before, key), new=_shown(after, key, before.get(key)))
        for key in {**before, **after}
        if key not in before or key not in after or before[key] != after[key]
    ]


def _shown(values: Mapping[str, Any], key: str, before: Any = None) -> str:
    """A value as people read it; of a long list how many of its entries differ from before."""
    if key not in values:
        return NONE
    value = values[key]
    if is_secret(key, value):
        return HIDDEN
    if isinstance(value, list) and len(value) > _MOST_SHOWN:
        same = sum(map(eq, value, before)) if isinstance(before, list) else None
        return f"{len(value)} entries" + ("" if same is None else f", {len(value) - same} differ")
    unit = _unit(key)
    if isinstance(value, dict):
        tolerance = value.get("tolerance")
        around = "" if tolerance is None else f" +- {100 * tolerance:g} %"
        return f"{_plain(value['value'])} {unit}".rstrip() + around
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{_plain(value)} {unit}".rstrip() if is_number else _plain(value)


def _unit(key: str) -> str:
    """Unit that the end of a key names; empty for none, or for one that nobody would know.

    >>> _unit("model.inertia_kg_m2"), _unit("noise_density_nm2_s")
    ('kg m2', '')
    """
    parts = key.rpartition(".")[2].split("_")[1:]
    of_unit = list(takewhile(_OF_UNITS.__contains__, reversed(parts)))
    return _UNITS.get("_".join(reversed(of_unit)), "")


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
        shown = file.keys if file.change == "changed" else ()
        yield from (f"  {each.key}: {each.old} -> {each.new}" for each in shown)
    restart = [file.name for file in changed if file.needs_restart]
    if not changed:
        yield "nothing changes"
    elif restart:
        yield f"restart the service for {', '.join(restart)}"
    else:
        yield "no restart is needed; until one the service tells the bundle from before"
