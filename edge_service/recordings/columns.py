"""Assignment of a file's columns to channels."""

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

from ..exit_status import BadInputError
from ..messages.samples import CHANNELS, POSITION_CHANNELS, TIME, TORQUE, ColumnMap

ROW_NUMBER = "#row"
"""Stands for a column with the number of the row, from 0: the clock of a file without times."""

BY_NUMBER = "#"
"""Columns of a text file without a header are #1, #2, ..."""
_NAMES_SHOWN = 12


class TraceError(BadInputError):
    """A file that cannot be read or written as a trace; the text is one line."""


class AxisError(TraceError):
    """The axis that is wanted is not there, or none is named and there are several."""


def choose_columns(
    path: Path,
    names: Sequence[str],
    columns: Mapping[str, ColumnMap],
    known: Mapping[str, ColumnMap],
) -> dict[str, ColumnMap]:
    """Column of `time_s` and of each channel that the file holds, in the order of writing.

    A mapped channel whose foreign column is absent is read from its canonical column, or from the
    one known by its name, so one machine file serves recordings of several makers.

    Args:
        names: the columns that the file has.
        columns: channel or `time_s` -> foreign column.
        known: channel -> column that is known by its name; present in `names`.

    Raises TraceError: a mapped column, `time_s`, or every torque and position channel is missing,
    or a wanted column is there twice, or twice but for upper and lower case.
    """
    chosen = {}
    for channel in (TIME, *CHANNELS):
        column = _choose(path, channel, names, columns.get(channel), known.get(channel))
        if column is not None:
            chosen[channel] = column
    wanted = [name for each in columns.values() for name in each.names]
    for name in (*wanted, TIME, *CHANNELS):
        twins = [each for each in names if each.startswith(f"{name} {BY_NUMBER}")]
        if twins and name not in names:
            raise TraceError(f"{path}: column {name!r} appears more than once: {there_are(twins)}")
    if TIME not in chosen and f"{BY_NUMBER}1" in names:
        raise TraceError(
            f"{path}: numbers without a header; name the columns in the machine file: [columns] "
            f'time_s = {{ column = "{BY_NUMBER}1", scale = 0.001 }}; {there_are(names)}'
        )
    adopt = f"; edge-service adopt {quote(path.name)} --out m.toml reads foreign names"
    if TIME not in chosen:
        hint, adopt = _hint(TIME, names), "" if _hint(TIME, names) else adopt
        raise TraceError(f"{path}: no column {TIME!r}{hint}; {there_are(names)}{adopt}")
    if not any(channel in chosen for channel in (TORQUE, *POSITION_CHANNELS)):
        expected = f"expected one of {', '.join((TORQUE, *POSITION_CHANNELS))}; {there_are(names)}"
        raise TraceError(f"{path}: no torque and no position channel; {expected}{adopt}")
    for channel in [each for each in chosen if each in names and each not in columns]:
        twin = next((n for n in names if n != channel and n.casefold() == channel), None)
        if twin is not None:
            raise TraceError(
                f"{path}: columns {channel!r} and {twin!r} differ in case alone; delete one, or "
                f'choose in the machine file: [columns] {channel} = {{ column = "{twin}" }}'
            )
    return chosen


def _choose(
    path: Path,
    channel: str,
    names: Sequence[str],
    mapped: ColumnMap | None,
    known: ColumnMap | None,
) -> ColumnMap | None:
    if mapped is not None and mapped.column in names:
        for name in mapped.names:
            if name not in names:
                raise _absent(path, name, channel, names)
        return mapped
    if channel == TIME and mapped is not None and mapped.column == ROW_NUMBER and known is None:
        return ColumnMap(ROW_NUMBER, mapped.scale, mapped.offset)
    if channel in names:
        return ColumnMap(channel)
    if mapped is None or known is not None:
        return known
    raise _absent(path, mapped.column, channel, names)


def _absent(path: Path, column: str, channel: str, names: Sequence[str]) -> TraceError:
    return TraceError(
        f"{path}: no column {column!r}, which the machine file gives for {channel}"
        f"{_hint(column, names)}; {there_are(names)}"
    )


def _hint(name: str, names: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, names, n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def there_are(names: Sequence[str]) -> str:
    """The columns of a file in words, the first ones of many."""
    shown = ", ".join(repr(name[:40]) for name in names[:_NAMES_SHOWN])
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return f"there are {shown}{more}"
