"""Understanding of a recording: the stages in their order, and its torque."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from ...messages.samples import (
    EXTERNAL_FORCE,
    SETPOINT,
    SI,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    ColumnMap,
    Floats,
)
from ..sampling import wrap_of
from .clock import find_clock
from .guess import Known, Understanding
from .motion import Motion
from .names import QUANTITIES, ColumnName, Quantity, suits
from .relations import follows, is_unsigned
from .unnamed import with_quantities

_PLAIN = ((Quantity.TEMPERATURE, TEMPERATURE, "degC"), (Quantity.FORCE, EXTERNAL_FORCE, ""))
_MOST_A = 300.0
_FRICTION = 0.3
"""Share of an unnamed effort that must follow the direction."""


def understand(
    names: Sequence[ColumnName], values: Mapping[str, Floats], known: Known
) -> Understanding:
    """Find what the columns of one axis, and those of no axis, are; `known` comes first.

    Values are as they stand in the file, by column, shape (n,) each.
    """
    found = Understanding(lead_m=known.lead_m)
    columns, table = list(with_quantities(names, values)), dict(values)
    for before, after in zip(names, columns, strict=True):
        if before.quantity is not after.quantity:
            words = f"{after.name!r} moves like a {after.quantity.value}"
            found.say("columns", words, assumed=True)
    if known.period_s is None and Quantity.TIME in {each.quantity for each in columns}:
        changed = [np.diff(values[each.name], prepend=np.nan) != 0.0 for each in columns]
        new = np.any(changed, axis=0)
        if twice := len(new) - np.count_nonzero(new):
            table = {name: each[new] for name, each in values.items()}
            found.say("file", f"{twice} rows come twice and count once")
    twins = Counter(each.name.rpartition(" #")[0] for each in columns)
    columns = [each for each in columns if not _is_open(each, twins, found)]
    for each in [each for each in columns if each.is_position and wrap_of(table[each.name])]:
        columns.remove(each)
        words = f"it wraps, by {wrap_of(table[each.name]):g}; unwrap it first"
        found.say("columns", f"{each.name!r} is left out: {words}", assumed=True)
    time_s = find_clock(columns, table, known, found)
    if time_s is None:
        return found
    motion = Motion(columns, table, time_s, known, found)
    motion.find()
    _find_effort(columns, table, motion.speed(), known, found)
    for quantity, channel, usual in _PLAIN:
        able = [each for each in columns if each.quantity is quantity and (each.unit or usual)]
        for each in able[:1]:
            found.columns[channel] = ColumnMap(each.name, SI[each.unit or usual][0])
            found.say(channel, f"{each.name!r} in {each.unit or usual}")
    return found


def _is_open(column: ColumnName, twins: Mapping[str, int], found: Understanding) -> bool:
    """Ask for the unit of a column that states one which is not known, and which of twins it is."""
    key = next((key for key, each in QUANTITIES.items() if each is column.quantity), "")
    if column.quantity is Quantity.POSITION:
        key = TABLE_POSITION
    stated = column.stranger or ("" if suits(column.unit, column.quantity) else column.unit)
    why = f"{stated!r} is no unit that is known for a {column.quantity.value}" if stated else ""
    base = "" if column.is_given or column.quantity is Quantity.TIME else column.name
    if (base := base.rpartition(" #")[0]) and twins[base] > 1:
        why = "another column has the same name"
    if key and why:
        found.ask("--column", f'"{key}={column.name}:UNIT"', why)
    return bool(key and why)


def _find_effort(
    names: list[ColumnName],
    values: dict[str, Floats],
    speed: Floats | None,
    known: Known,
    found: Understanding,
) -> None:
    """Choose the torque channel; says and asks what there is to it."""
    column = _best_effort(names, values, speed)
    if column is None and not found.questions:
        found.say(TORQUE, "not understood; name it or a current: --column current=COLUMN:UNIT")
    if column is None:
        return
    effort = values[column.name]
    scale, words = _effort_scale(column, effort, known, found)
    direction = _direction(column.name, effort, speed, found)
    if scale is not None:
        found.columns[TORQUE] = ColumnMap(column.name, scale, direction=direction)
        found.say(TORQUE, words)


def _best_effort(
    names: list[ColumnName], values: dict[str, Floats], speed: Floats | None
) -> ColumnName | None:
    """A torque, else a current that follows the direction, else whatever does so."""
    for quantity in (Quantity.TORQUE, Quantity.CURRENT):
        able = [each for each in names if each.quantity is quantity]
        able = [each for each in able if np.nanstd(values[each.name]) > 0.0]
        if able:
            return min(able, key=lambda each: (each.rank, -_share(values[each.name], speed)))
    volts = [each for each in names if each.quantity is Quantity.OTHER and each.unit in ("V", "%")]
    shares = {each.name: _share(values[each.name], speed) for each in volts}
    able = [each for each in volts if shares[each.name] > _FRICTION]
    return max(able, key=lambda each: shares[each.name], default=None)


def _share(effort: Floats, speed: Floats | None) -> float:
    return 0.0 if speed is None else abs(follows(effort, speed))


def _effort_scale(
    column: ColumnName, values: Floats, known: Known, found: Understanding
) -> tuple[float | None, str]:
    """Factor to N m at the motor, with words; None where it is not known."""
    if column.si_unit == "N m":
        return SI[column.unit][0], f"{column.name!r} in {column.unit} ({column.why})"
    unit = column.unit or "unit"
    if column.quantity is Quantity.CURRENT and not column.unit:
        high = float(np.nanpercentile(np.abs(values), 99.0))
        unit = "A" if high < _MOST_A else "mA"  # no feed drive takes hundreds of amperes
        found.say(TORQUE, f"{column.name!r} is taken as a current in {unit}", assumed=True)
    unit, per_unit = ("A", 1e-3) if unit == "mA" else (unit, 1.0)
    if known.torque_constant is not None:
        scale = per_unit * known.torque_constant
        return scale, f"{column.name!r} times {known.torque_constant:g} N m/{unit}, as given"
    if column.quantity is Quantity.TORQUE and not column.unit:
        found.say(TORQUE, f"{column.name!r} is taken as N m: its name gives no unit", assumed=True)
        return 1.0, f"{column.name!r}"
    what = "current" if column.quantity is Quantity.CURRENT else "effort"
    found.say(TORQUE, f"{column.name!r} is the drive's {what}; N m per {unit} are not known")
    words = f"Torque of the motor per {unit} of {column.name!r}, N m"
    found.ask("--torque-constant", words, "inertia and friction in N m need it")
    return None, ""


def _direction(name: str, effort: Floats, speed: Floats | None, found: Understanding) -> str:
    """Column whose direction an effort without a sign takes; empty where it has one."""
    if speed is None or not is_unsigned(effort, speed):
        return ""
    channel = SETPOINT if SETPOINT in found.columns else TABLE_POSITION
    words = f"{name!r} has no sign: it is positive both ways. It gets the sign of the direction, "
    words += "which is right in steady motion and wrong while the axis brakes"
    found.say(TORQUE, words, assumed=True)
    return found.columns[channel].column if channel in found.columns else ""
