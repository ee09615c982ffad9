"""Text with a value a row, with times for each channel, or with the newest row first, as a table.

A channel that is slower than the others keeps its value until its next one, which the checks see
and name; nothing is drawn between two samples.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..messages.samples import TIME, Floats
from .columns import TraceError
from .source import NO_TEXT, Source, TableSource, Text, floats_from_text
from .text import LARGEST_TABLE, TextSource

_APART = 0.05
"""Share of the rows at times that the densest channel does not have."""
_DECIMAL = re.compile(r"\s*[-+\u2212]?\d+[.,]\d+\s*")
"""A number that no count and no quality is: beside its one value a row of long form has none."""
_ALIKE = 50.0
"""Times of one unit: channels are sampled within this factor of each other."""
_NUMBER = re.compile(r"\s*[-+.\u2212]?\d")
_TABLE = tomllib.loads((files(__package__) / "forms.toml").read_text("utf-8"))["long"]
_CAMONITOR = re.compile(_TABLE["camonitor"].encode())
_LIKE = {name: re.compile(text, re.IGNORECASE).fullmatch for name, text in _TABLE.items()}
Group = tuple[Any, dict[str, Any]]
"""Cells of a time, and those of the channels that have it."""


def open_text(path: Path, file: IO[bytes]) -> Source:
    """Rows of a text file, or its cells in rows of one time, oldest first. Raises TraceError."""
    is_monitored = _CAMONITOR.match(file.readline(LARGEST_TABLE))
    file.seek(0)
    if is_monitored:
        with file:
            lines = _CAMONITOR.sub(rb"\1;\2;\3;\4", file.read(LARGEST_TABLE))
        file = BytesIO(b"variable;time;value;state\n" + lines)
    source = TextSource(path, file)
    first = dict(zip(source.names, zip(*source.sample, strict=False), strict=False))
    words = [n for n, cells in first.items() if n and not any(map(_NUMBER.match, cells))]
    pairs = source.names[::2]
    able = pairs if len(pairs) > 1 and all(map(_LIKE["time"], pairs)) else first
    times = [name for name in able if _LIKE["time"](name) and name not in words]
    tags = [name for name in words if _LIKE["tag"](name)]
    tags += [name for name in words if 1 < len(set(first[name])) <= len(first[name]) / 2.0]
    values = list(filter(_LIKE["value"], first))
    others = [first[name] for name in first if name not in (*times, *words, *values)]
    if times and tags and values and not any(map(_DECIMAL.fullmatch, sum(others, ()))):
        cells = source.cells([*times, values[0], *words])
        time = next((name for name in times if len(cells[name].unique()) > 1), times[0])
        return _arranged(source, file, time, _of_tags(cells, time, tags[0], values[0], words))
    if groups := _groups(source, first, times):
        cells = source.cells([name for name in source.names if name])
        apart = [(cells[t], {n: cells[n] for n in names if n}) for t, names in groups.items()]
        arranged = _arranged(source, file, times[0], apart)
        if len(groups) == 1:
            arranged.notes.append(f"{times[0]!r} falls: read as newest row first, no countdown")
        return arranged
    return source


def _groups(
    source: TextSource, first: Mapping[str, Sequence[str]], times: Sequence[str]
) -> dict[str, Sequence[str]]:
    """Channels by the time that they have; none where the rows are in order."""
    names = source.names
    at = [*map(names.index, times), len(names)]
    groups: dict[str, Sequence[str]] = {names[a]: names[a + 1 : b] for a, b in pairwise(at)}
    behind = at[0] == 0 and len(groups) > 1 and all(groups.values())
    if TIME in first and not behind:
        return {}
    import pyarrow as pa

    with np.errstate(all="ignore"):
        read = [floats_from_text(pa.array(first[name]), source.decimal_point)[0] for name in times]
        steps = [np.diff(each) for each in read if len(each) > 1]
    usual = [float(abs(np.median(e))) if np.all(e >= 0) or np.all(e <= 0) else 0.0 for e in steps]
    if behind and 0.0 < max(usual, default=0.0) < _ALIKE * min(usual):
        return groups
    if TIME not in first and steps and all(np.all(each < 0.0) for each in steps):
        return {times[0]: [name for name in first if name != times[0]]}
    return {}


def _of_tags(cells: Any, time: str, tag: str, value: str, words: Sequence[str]) -> list[Group]:
    """A channel for each tag; a column of units is part of the tag, and a bad value is none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    said = {n: pc.utf8_trim_whitespace(cells[n].cast(pa.string()).fill_null("")) for n in words}
    names, values = said[tag], cells[value]
    for name in words:
        if _LIKE["unit"](name):
            named = pc.binary_join_element_wise(names, " [", said[name], "]", "")
            names = pc.if_else(pc.equal(said[name], ""), names, named)
        bad = pc.match_substring_regex(said[name], f"(?i)^{_TABLE['bad']}")
        values = pc.if_else(bad, b"nan", values)
    of_tag = {name: pc.equal(names, name) for name in names.unique().to_pylist() if name}
    return [(cells[time].filter(at), {n: values.filter(at)}) for n, at in of_tag.items()]


def _arranged(source: TextSource, file: IO[bytes], time: str, groups: list[Group]) -> TableSource:
    """Columns of all channels at all times; each keeps its value until its next one."""
    text: dict[str, Text] = {}

    def read(name: str, cells: Any) -> Floats:
        numbers, unread = floats_from_text(cells, source.decimal_point)
        if unread is not None:
            text[name] = text.get(name, NO_TEXT) + unread
        return numbers

    series: dict[str, tuple[Floats, Floats]] = {}
    for time_cells, channels in groups:
        at = read(time, time_cells)
        rows = np.flatnonzero(np.isfinite(at))
        if len(rows) and at[rows[0]] > at[rows[-1]]:
            rows = rows[::-1]
        for name, cells in channels.items():
            series[name] = at[rows], read(name, cells)[rows]
            with np.errstate(all="ignore"):
                steps, changes = map(np.diff, series[name])
            if np.any((steps < 0.0) | ((steps == 0.0) & (np.abs(changes) > 0.0))):
                why = "two series of one name, or a clock that was put back: keep one of each name"
                raise TraceError(f"{source.path}: {name!r}: {why}")
    of_each = [at for at, _ in series.values()]
    times = np.unique(np.concatenate([np.empty(0), *of_each]))
    if time in text and not len(times):
        raise TraceError(f"{source.path}: {time!r}: {text[time]}")
    if len(times) > (1.0 + _APART) * max(map(len, of_each), default=0):
        why = "each channel has times of its own, and they differ: record all at one time"
        raise TraceError(f"{source.path}: {why}")
    columns = {time: times}
    for name, (at, values) in series.items():
        columns[name] = np.append(np.nan, values)[np.searchsorted(at, times, side="right")]
    arranged = TableSource(source.path, file, columns, text)
    arranged.ragged_rows = source.ragged_rows
    below = [dict(zip(source.names, row, strict=False)) for row in source.below]
    arranged.below = [[row.get(name, "") for name in columns] for row in below]
    return arranged
