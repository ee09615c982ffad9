"""Text with a value a row, with times for each channel, or with the newest row first, as a table.

Cells stay as they are written. A channel that is slower than the others keeps its cell until its
next one, which the checks see and name; nothing is drawn between two samples.
"""

import io
import re
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..messages.samples import TIME, Floats
from .columns import TraceError
from .source import floats_from_text
from .text import TextSource

_APART = 0.05
"""Share of the rows at times that the densest channel does not have."""
_MOST_DECIMAL = 4
"""Columns of numbers with decimals, or of times or names with dots, where a row has one value."""
_ALIKE = 50.0
"""Times of one unit: channels are sampled within this factor of each other."""
_NUMBER = re.compile(r"\s*[-+.\u2212]?\d")
_TABLE = tomllib.loads((files(__package__) / "forms.toml").read_text("utf-8"))["long"]
_LIKE = {name: re.compile(text, re.IGNORECASE).fullmatch for name, text in _TABLE.items()}
Record = tuple[Any, Any, Any]
"""Arrow's columns of times, names and values."""


def open_text(path: Path, file: IO[bytes]) -> TextSource:
    """Rows of a text file, or its cells in rows of one time, oldest first. Raises TraceError."""
    source = _arranged(TextSource(path, file))
    first = dict(zip(source.names, zip(*source.sample, strict=False), strict=False))
    steps = [_steps(source, first[name]) for name in first if _LIKE["time"](name)]
    if TIME not in first and steps and all(len(e) and np.all(e < 0.0) for e in steps):
        table = source.table(source.names)
        return _opened(source, table.take(np.arange(len(table))[::-1]))
    return source


def _steps(source: TextSource, cells: Sequence[str]) -> Floats:
    """Steps between the first cells of a column, (n - 1,)."""
    import pyarrow as pa

    with np.errstate(over="ignore", invalid="ignore"):
        steps: Floats = np.diff(floats_from_text(pa.array(cells), source.decimal_point)[0])
    return steps


def _arranged(source: TextSource) -> TextSource:
    """The source, or one with a column for each channel and one time for all."""
    import pyarrow as pa

    first = dict(zip(source.names, zip(*source.sample, strict=False), strict=False))
    words = [n for n, cells in first.items() if n and not any(map(_NUMBER.match, cells))]
    pairs = source.names[::2]
    able = pairs if len(pairs) > 1 and all(map(_LIKE["time"], pairs)) else first
    times = [name for name in able if _LIKE["time"](name) and name not in words]
    tags = [name for name in words if _LIKE["tag"](name)]
    tags += [name for name in words if 1 < len(set(first[name])) <= len(first[name]) / 2.0]
    values = list(filter(_LIKE["value"], first))
    decimal = [cells for cells in first.values() if {".", ","} & {*"".join(cells)}]
    if times and tags and values and len(decimal) <= _MOST_DECIMAL:
        return _of_tags(source, times, tags[0], values[0], words)
    steps = [_steps(source, first[each]) for each in times if len(source.sample) > 1]
    usual = [float(np.median(each)) if np.all(each >= 0.0) else 0.0 for each in steps]
    groups = _groups(source.names, times)
    if len(groups) > 1 and all(groups) and 0.0 < max(usual) < _ALIKE * min(usual):
        table = source.table(source.names)
        spans = sorted(zip(times, groups, strict=True), key=lambda each: table[each[0]].null_count)
        long = [(table[t], pa.repeat(n, len(table)), table[n]) for t, names in spans for n in names]
        return _pivoted(source, times[0], long)
    return source


def _groups(names: Sequence[str], times: Sequence[str]) -> list[Sequence[str]]:
    """Channels behind each of the times; none where the first column is no time."""
    at = [*map(names.index, times), len(names)]
    return [names[a + 1 : b] for a, b in pairwise(at)] if at[0] == 0 else []


def _of_tags(
    source: TextSource, times: Sequence[str], tag: str, value: str, words: Sequence[str]
) -> TextSource:
    """A column for each tag; a column of units is part of the tag, and a bad value is none."""
    import pyarrow.compute as pc

    table = source.table([*times, value, *words])
    names, values = table[tag], table[value]
    for name in words:
        if _LIKE["unit"](name):
            unit = pc.binary_join_element_wise(" [", table[name], "]", "")
            names = pc.coalesce(pc.binary_join_element_wise(names, unit, ""), names)
        bad = pc.match_substring_regex(table[name], f"(?i)^{_TABLE['bad']}")
        values = pc.if_else(pc.fill_null(bad, False), "nan", values)
    time = next((each for each in times if pc.count_distinct(table[each]).as_py() > 1), times[0])
    return _pivoted(source, time, [(table[time], names, values)])


def _pivoted(source: TextSource, time: str, records: Sequence[Record]) -> TextSource:
    """Rows of records; an empty cell is that of the row before."""
    import pyarrow as pa
    import pyarrow.compute as pc

    parts = [pa.table({"time": t, "name": n, "value": v}) for t, n, v in records]
    long = pa.concat_tables(parts).drop_null()
    names = pc.unique(long["name"]).to_pylist()
    pivot = [(["name", "value"], "pivot_wider", pc.PivotWiderOptions(names))]
    try:
        rows = long.group_by("time", use_threads=False).aggregate(pivot)
    except pa.ArrowInvalid:
        why = "one value a row, but two of one name at one time: keep one series of each name"
        raise TraceError(f"{source.path}: {why}") from None
    order = pc.index_in(rows["time"], pc.unique(long["time"]))  # groups come in any
    rows = rows.take(pc.sort_indices(order))
    wide = rows["name_value_pivot_wider"].combine_chunks().flatten()
    if len(rows) > (1.0 + _APART) * max(len(each) - each.null_count for each in wide):
        why = "each channel has times of its own, and they differ: record all at one time"
        raise TraceError(f"{source.path}: {why}")
    held = dict(zip(names, map(pc.fill_null_forward, wide), strict=True))
    return _opened(source, pa.table({time: rows["time"], **held}))


def _opened(source: TextSource, table: Any) -> TextSource:
    """A table of cells as text once more, with the rows below its names."""
    import pyarrow.csv

    file = io.BytesIO()
    below = [dict(zip(source.names, row, strict=False)) for row in source.below]
    for line in (dict(zip(table.column_names, table.column_names, strict=True)), *below):
        file.write("\t".join(line.get(name, "") for name in table.column_names).encode() + b"\n")
    options = pyarrow.csv.WriteOptions(include_header=False, delimiter="\t", quoting_style="none")
    pyarrow.csv.write_csv(table, file, options)
    source.close()
    opened = TextSource(source.path, file)
    opened.ragged_rows = source.ragged_rows
    return opened
