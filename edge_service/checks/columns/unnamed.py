"""Quantities of columns whose names say nothing: found by how they move with each other."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from ...messages.samples import Floats
from .names import ColumnName, Quantity
from .relations import changes, follows, lags, proportion, smoothed_speed, travelled, whole_windows

_SURE = 0.95
"""Correlation over windows from which one column is the speed, or another position, of another."""
_FRICTION = 0.3
"""Share of an effort that must follow the direction."""
_ENDS = 0.02
"""Of the travel: a column with both ends of it is another position, not an effort."""
_STEPS = 0.9
"""A column that stands still for so many samples, and then jumps, is no profile of a motion."""


def with_quantities(
    names: Sequence[ColumnName], values: Mapping[str, Floats]
) -> tuple[ColumnName, ...]:
    """The same columns, the unnamed ones with what they were found to be."""
    open_names = [each.name for each in names if each.quantity is Quantity.UNNAMED]
    open_names = [name for name in open_names if np.ptp(known_of(values[name])) > 0.0]
    if not open_names or any(each.quantity is Quantity.POSITION for each in names):
        return tuple(names)
    found = _found(open_names, names, values)
    return tuple(replace(each, quantity=found.get(each.name, each.quantity)) for each in names)


def _found(
    open_names: list[str], names: Sequence[ColumnName], values: Mapping[str, Floats]
) -> dict[str, Quantity]:
    clocks = [each.name for each in names if each.quantity is Quantity.TIME]
    clock = [*clocks, *(name for name in open_names if is_clock(values[name])), ""][0]
    found = {} if clocks or not clock else {clock: Quantity.TIME}
    rest = [name for name in open_names if name != clock]
    rest = [name for name in rest if np.mean(np.diff(values[name]) == 0.0) <= _STEPS]
    time_s = values[clock] if clock else np.arange(len(values[open_names[0]]), dtype=np.float64)
    windows = whole_windows(time_s)
    correlation, position, speed = _position_and_speed(rest, values, time_s, windows)
    if correlation <= _SURE:
        return found
    position = _later(position, [name for name in rest if name != speed], values, windows)
    found |= {position: Quantity.POSITION, speed: Quantity.SPEED}
    others = [name for name in rest if name not in (position, speed)]
    found |= _setpoint(others, values, position, windows)
    motion = smoothed_speed(values[position], time_s)
    others = [name for name in others if name not in found]
    others = [name for name in others if not _same_ends(values[name], values[position])]
    efforts = {name: abs(follows(values[name], motion)) for name in others}
    strongest = max(efforts, key=efforts.__getitem__, default="")
    if strongest and efforts[strongest] > _FRICTION:
        found[strongest] = Quantity.CURRENT
    return found


def is_clock(values: Floats) -> bool:
    """Column that counts up by nearly even steps, apart from new starts and gaps."""
    steps = np.diff(known_of(values))
    if steps.size < 10 or not np.all(np.isfinite(steps)):
        return False
    forward = steps[steps > 0.0]
    if forward.size < 0.95 * steps.size:
        return False
    usual = float(np.median(forward))
    return float(np.mean(np.abs(forward - usual) < 0.5 * usual)) > 0.9


def _position_and_speed(
    names: list[str], values: Mapping[str, Floats], time_s: Floats, windows: Floats
) -> tuple[float, str, str]:
    """Greatest correlation of a column's changes with the integral of another, and those two."""
    found = [(0.0, "", "")]
    for position, speed in permutations(names, 2):
        travel = travelled(values[speed], time_s, windows)
        if link := proportion(changes(values[position], windows), travel):
            found.append((link.correlation, position, speed))
    return max(found, key=lambda each: each[0])


def _later(position: str, names: list[str], values: Mapping[str, Floats], windows: Floats) -> str:
    """The last to move of all columns that move alike: the others are its set points."""
    latest = position
    for name in names:
        link = proportion(changes(values[name], windows), changes(values[position], windows))
        if link is None or link.correlation <= 0.8 or not 0.5 < link.factor < 2.0:
            continue
        late = lags(values[name], values[latest])
        own, other = (np.mean(np.diff(values[each]) == 0.0) for each in (name, latest))
        if late > 0.0 or (late == 0.0 and own < other):  # by samples, or with noise of its own
            latest = name
    return latest


def _same_ends(values: Floats, position: Floats) -> bool:
    one, other = known_of(values), known_of(position)
    apart = max(abs(one.min() - other.min()), abs(one.max() - other.max()))
    return bool(apart < _ENDS * np.ptp(other))


def _setpoint(
    names: list[str], values: Mapping[str, Floats], position: str, windows: Floats
) -> dict[str, Quantity]:
    """The column that moves like the position, by the same amount, and not by jumps."""
    moved, alike = changes(values[position], windows), dict[str, float]()
    for name in names:
        link = proportion(moved, changes(values[name], windows))
        if link and link.correlation > 0.8 and 0.5 < link.factor < 2.0:
            alike[name] = link.correlation
    return {max(alike, key=alike.__getitem__): Quantity.SETPOINT} if alike else {}


def known_of(values: Floats) -> Floats:
    """The numbers of a column, shape (n,); a zero where there is none."""
    known: Floats = values[np.isfinite(values)]
    return known if known.size else np.zeros(1)
