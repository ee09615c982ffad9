"""Columns of a recording as they stand in the file, and those of one axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..checks.columns.names import (
    QUANTITIES,
    ColumnName,
    Quantity,
    column_names,
    suits,
    unit_of,
    units_below,
)
from ..messages.samples import Floats
from ..recordings.columns import TraceError, there_are
from ..recordings.forms import open_source
from ..recordings.sinumerik.edge import edge_recording
from ..recordings.sinumerik.signals import ControllerAxis
from ..recordings.source import NO_TEXT, Text

_MOST_ROWS = 500_000
"""Rows that the meaning of the columns is judged by."""
_OF_AXIS = (
    Quantity.SETPOINT,
    Quantity.MOTOR_POSITION,
    Quantity.TABLE_POSITION,
    Quantity.POSITION,
    Quantity.TORQUE,
    Quantity.CURRENT,
)


@dataclass(frozen=True, slots=True, eq=False)
class RawColumns:
    """The numeric columns of a file."""

    names: tuple[ColumnName, ...]  # in the order of the file, with what they mean
    values: Mapping[str, Floats]  # column -> values, shape (n,) each
    remarks: tuple[str, ...] = ()  # what its reader had to say, one line each

    @property
    def axes(self) -> list[str]:
        """Axes of which a position or an effort is there, as the file spells them."""
        return list(dict.fromkeys(e.axis for e in self.names if e.axis and e.quantity in _OF_AXIS))

    def of_axis(self, axis: str) -> tuple[ColumnName, ...]:
        """Columns of an axis, and those of none."""
        return tuple(each for each in self.names if each.axis in ("", axis))

    def axis(self, path: Path, number: int | None) -> tuple[str, int | None]:
        """Axis as the file spells it, and its number; empty and None where it names none.

        Args:
            number: of the controller, or place among the axes; needed where there are several.
        """
        numbers = {int(axis) if axis.isdigit() else k + 1: axis for k, axis in enumerate(self.axes)}
        if not numbers:
            return "", None
        if number is None and len(numbers) > 1:
            shown = ", ".join(
                axis if axis == str(each) else f"{each} ({axis})" for each, axis in numbers.items()
            )
            raise TraceError(
                f"{path}: axes there are: {shown}; expected the number of the one wanted "
                "(--axis-number)"
            )
        number = next(iter(numbers)) if number is None else number
        if number not in numbers:
            known = ", ".join(map(str, numbers))
            raise TraceError(f"{path}: no axis {number}; axes there are: {known}")
        return numbers[number], number if numbers[number].isdigit() else None


def read_columns(path: Path, given: Sequence[str]) -> RawColumns:
    """Read a file of any form.

    Args:
        given: what the owner says of columns, `QUANTITY=COLUMN` or `QUANTITY=COLUMN:UNIT`.

    Raises TraceError: it cannot be read, has no numbers, or not what is said of it.
    """
    try:
        source = edge_recording(path, open_source(path, ControllerAxis()), {})
    except OSError as error:
        raise TraceError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        able = [name for name in dict.fromkeys(source.names) if source.holds_numbers(name)]
        single = [name for name in able if name and list(source.names).count(name) == 1]
        source.want(single)
        blocks, rows, unread = [], 0, dict[str, Text]()
        while rows < _MOST_ROWS and (block := source.read_block()) is not None:
            blocks.append(block.values)
            rows += len(block)
            for name, text in block.text.items():
                unread[name] = unread.get(name, NO_TEXT) + text
    finally:
        source.close()
    values = {name: np.concatenate([block[name] for block in blocks]) for name in single if blocks}
    numeric = [name for name, each in values.items() if np.isfinite(each).any()]
    said = [f"{name!r}: {text}" for name, text in unread.items()]
    if not numeric:
        raise TraceError("; ".join([f"{path}: holds no column of numbers", *said[:1]]))
    names = _with_given(path, column_names(numeric, units_below(source.names, source.below)), given)
    remarks = (*source.remarks, *said)
    return RawColumns(tuple(names), {name: values[name] for name in numeric}, remarks)


def _with_given(path: Path, names: Sequence[ColumnName], given: Sequence[str]) -> list[ColumnName]:
    said = dict(_parse(text) for text in given)
    there = [each.name for each in names]
    for name in said:
        if name not in there:
            raise TraceError(f"{path}: --column: no column {name!r}; {there_are(there)}")
    chosen = {quantity for quantity, _ in said.values()}
    if chosen & {Quantity.TORQUE, Quantity.CURRENT}:
        chosen |= {Quantity.TORQUE, Quantity.CURRENT}
    result = []
    for each in names:
        if each.name in said:
            quantity, unit = said[each.name]
            unit, stranger = (unit, "") if unit else (each.unit, each.stranger)
            told = replace(each, quantity=quantity, unit=unit, stranger=stranger, is_given=True)
            result.append(told)
        else:
            quantity = Quantity.OTHER if each.quantity in chosen else each.quantity
            result.append(replace(each, quantity=quantity))
    return result


def _parse(text: str) -> tuple[str, tuple[Quantity, str]]:
    word, equals, rest = text.partition("=")
    name, colon, unit = rest.rpartition(":")
    if not colon:
        name, unit = rest, ""
    if not equals or word not in QUANTITIES or not name:
        words = ", ".join(QUANTITIES)
        raise TraceError(f"--column {text!r}: expected QUANTITY=COLUMN[:UNIT], of {words}")
    quantity = QUANTITIES[word]
    known = unit_of(unit, quantity)
    if unit and not (known and suits(known, quantity)):
        raise TraceError(f"--column {text!r}: {unit!r} is no unit that is known for {word}")
    return name, (quantity, known)
