"""An open file of one form, and the rows that it gives, before channels and units."""

import contextlib
import io
import math
import os
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from ..messages.samples import Floats

MOST_COLUMNS, _TABLE_ROWS = 4096, 1 << 14
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# Arrow's own pool keeps some 40 MB of what eight readers have let go.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
_CELLS = tomllib.loads((files(__package__) / "cells.toml").read_text("utf-8"))


@dataclass(frozen=True, slots=True)
class Text:
    """Cells of one column that should be numbers and are not: how many, the commonest of them."""

    count: int
    named: dict[str, int]

    def __add__(self, other: "Text") -> "Text":
        named = Counter(self.named) + Counter(other.named)
        return Text(self.count + other.count, dict(named.most_common(3)))

    def __str__(self) -> str:
        cells = ", ".join(f"{cell!r} ({count})" for cell, count in self.named.items())
        return f"{self.count} cells are no numbers: {cells}"


NO_TEXT = Text(0, {})


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Rows of some columns."""

    # column name -> values as they stand in the file, shape (n,); NaN where a cell holds no number
    values: dict[str, Floats]
    # number of each row in the file, from 0, rows set aside included, shape (n,)
    row_number: Floats
    # what stands in place of numbers, for the columns where something does
    text: dict[str, Text] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.row_number.shape[0])


class Source:
    """An open file of one form; forms override `read_block` and what is not as usual.

    Attributes:
        path: the file.
        names: the columns that it has.
        below: rows of words below the names, such as their units.
        notes: remarks of the form.
        ragged_rows: rows with too few or too many cells, set aside so far.
        wanted: the columns that are read.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path = path
        self.names: tuple[str, ...] = ()
        self.below: list[list[str]] = []
        self.notes: list[str] = []
        self.ragged_rows = 0
        self.wanted: list[str] = []
        self._file = file
        self._bytes = max(file.seek(0, io.SEEK_END), 1)
        self._length = self._rows_seen = 0  # of the file, where its form says it
        file.seek(0)

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        if self._length:
            return self._rows_seen / self._length
        return 1.0 if self._file.closed else self._file.tell() / self._bytes

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks that a reader of the rows should know, one line each."""
        return tuple(self.notes)

    def holds_numbers(self, name: str) -> bool:
        """Return whether a column may hold numbers."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only. Raises TraceError for one that cannot hold numbers."""
        self.wanted = names

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        raise NotImplementedError

    def close(self) -> None:
        self._file.close()

    def _number_rows(self, count: int) -> Floats:
        """Numbers of the next rows of the file, shape (count,)."""
        first, self._rows_seen = self._rows_seen, self._rows_seen + count
        return np.arange(first, first + count, dtype=np.float64)


class TableSource(Source):
    """Columns in memory, (n,) each by name, and what stands there in place of numbers."""

    def __init__(
        self,
        path: Path,
        file: IO[bytes],
        columns: Mapping[str, npt.NDArray[Any]],
        text: Mapping[str, Text] | None = None,
    ) -> None:
        super().__init__(path, file)
        self.names, self._columns, self._text = tuple(columns), columns, text or {}
        self._length = len(next(iter(columns.values())))

    def read_block(self) -> Block | None:
        rows = slice(self._rows_seen, min(self._rows_seen + _TABLE_ROWS, self._length))
        if rows.start == rows.stop:
            return None
        values = {name: self._columns[name][rows].astype(np.float64) for name in self.wanted}
        text = {} if rows.start else {n: self._text[n] for n in self.wanted if n in self._text}
        return Block(values, self._number_rows(rows.stop - rows.start), text)


def number_of(value: Any) -> float:
    """The number that something is or says; NaN where it says none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def floats_from_text(cells: Any, decimal_point: str = ".") -> tuple[Floats, Text | None]:
    """Numbers in an Arrow array of byte strings; NaN and an account of it where there is none.

    Times as people write them become seconds since 1970, or since midnight.

    Returns:
        Values of shape (n,), and the cells that are neither a number nor a word for a missing one.
    """
    import pyarrow as pa

    if pa.types.is_floating(cells.type):
        return cells.to_numpy(zero_copy_only=False), None
    import pyarrow.compute as pc  # 0.2 s that a plain table does without

    def floats(raw: Any) -> Floats:
        text = pc.utf8_trim_whitespace(pc.cast(raw, pa.large_string()))
        values: Floats = pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False)
        return values

    def is_like(expression: str) -> Any:
        like = pc.match_substring_regex(raw, expression, ignore_case=True)
        return pc.fill_null(like, expression == _CELLS["missing"])

    raw, style = pc.cast(cells, pa.large_binary()), _CELLS[decimal_point]
    with contextlib.suppress(pa.ArrowInvalid):
        return floats(pc.replace_substring(raw, decimal_point, ".")), None
    for own, plain in _CELLS["characters"].items():
        raw = pc.replace_substring(raw, own, plain)
    raw = pc.replace_substring_regex(raw, _CELLS["fortran"], r"\1e\2")
    if pc.any(is_like(_CELLS["letters"])).as_py():
        for (mm, names), (date, iso) in product(_CELLS["months"].items(), _CELLS["dates"].items()):
            raw = pc.replace_substring_regex(
                raw, date.replace("MONTH", names), iso.replace("MM", mm)
            )
    if pc.any(is_like(style["surely"])).as_py():
        whole = pc.replace_substring_regex(raw, style["marks"], "")
        raw = pc.if_else(is_like(style["grouped"]), whole, raw)
    raw = pc.replace_substring(raw, decimal_point, ".")
    is_number, is_time = is_like(_CELLS["number"]), is_like(_CELLS["time"])
    values = floats(pc.if_else(is_number, raw, pa.scalar(None, pa.large_binary()))).copy()
    if pc.any(is_time).as_py():
        values[is_time.to_numpy(zero_copy_only=False)] = _seconds(raw.filter(is_time))
    known = pc.or_(pc.or_(is_number, is_like(_CELLS["missing"])), is_time)
    wrong = cells.filter(pc.invert(known))
    if len(wrong) == 0:
        return values, None
    counted = pc.value_counts(pc.cast(wrong, pa.binary())).to_pylist()
    texts = {each["values"].decode("utf-8", "replace")[:40]: each["counts"] for each in counted}
    return values, Text(len(wrong), texts) + NO_TEXT


def _seconds(cells: Any) -> Floats:
    """Written times, shape (n,), s: since 1970 where there is a date, else since midnight."""
    import pyarrow as pa
    import pyarrow.compute as pc

    text = pc.extract_regex(pc.cast(cells, pa.large_string()), f"(?i){_CELLS['time']}")

    def part(name: str) -> Floats:
        cells = pc.struct_field(text, name)
        cells = pc.replace_substring(pc.if_else(pc.equal(cells, ""), "0", cells), ":", ".")
        number = pc.cast(cells, pa.float64())
        return np.asarray(number.to_numpy(zero_copy_only=False))

    half, side = (pc.struct_field(text, name).to_numpy(False) for name in ("half", "side"))
    first, second, year = part("a"), part("b"), part("y") + part("c")
    american = (half != "") & (first <= 12.0)
    month = part("m") + np.where(american, first, second)
    day = part("d") + np.where(american, second, first)
    years = np.where(year > 0.0, year + 2000.0 * (year < 100.0) - 1970.0, 0.0)
    months = 12 * years.astype(int) + np.maximum(month - 1.0, 0.0).astype(int)
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.float64)
    days += np.maximum(day - 1.0, 0.0)
    hour = part("H") % np.where(half != "", 12.0, 24.0) + 12.0 * np.isin(half, ("PM", "pm"))
    east = np.where(side == "-", -60.0, 60.0) * (60.0 * part("zh") + part("zm"))
    seconds: Floats = 86400.0 * days + 3600.0 * hour + 60.0 * part("M") + part("S") - east
    return seconds
