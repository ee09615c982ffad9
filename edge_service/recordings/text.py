"""Rows of a text file, block by block, and its layout: delimiter, decimal point, column names."""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from .columns import BY_NUMBER, TraceError
from .source import BYTE_ORDER_MARK, MOST_COLUMNS, Block, Source, floats_from_text

BLOCK_BYTES = 1 << 19
LONGEST_LINE, LARGEST_TABLE = 1 << 22, 1 << 29
SPACES = " "
"""Any number of spaces."""
_SPACES, _AT_ENDS = re.compile(rb"[ \t]+"), re.compile(rb"^ | (?=\r?$)", re.MULTILINE)
_QUOTED = re.compile(rb'"([^"\r\n]*)"')
_DELIMITERS = (",", ";", "\t", "|")
_SAMPLE_LINES, _MOST_ABOVE = 20, 100
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\ufffd]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_QUOTED_COMMA = re.compile(r"[+-]?\d*,(\d{1,2}|\d{4,})([eE][+-]?\d+)?")
"""A decimal comma in quotes, between cells parted by commas: it parts no thousands."""
_PARTED = re.compile(r"(?<=\d)[,.' \u2019](?=\d{3}(?!\d))")
_AS_PYTHON = str.maketrans(",Dd\u2212", ".EE-")
_SCOPE, _TICKS_LENGTH = "SampleTime[ms]", 15
_WHOLE = re.compile(r"[+-]?\d+([eE][+-]?\d+)?")


class TextSource(Source):
    """An open CSV file. Cells that are no numbers become NaN, ragged rows are counted."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self._rest, self._are_plain = b"", True
        self._read_layout(file.read(BLOCK_BYTES))
        if len(self.names) > MOST_COLUMNS:
            raise TraceError(f"{path}: more than {MOST_COLUMNS} columns")

    def read_block(self) -> Block | None:
        raw = self._read_lines()
        if raw is None:
            return None
        table, ragged = self._read_csv(raw)
        rows = table.num_rows + len(ragged)
        number = np.delete(self._number_rows(rows), [min(row, rows) - 1 for row in ragged])
        block = Block({}, number)
        for name, column in zip(dict.fromkeys(self.wanted), table.columns, strict=True):
            block.values[name], wrong = floats_from_text(column, self.decimal_point)
            if wrong is not None:
                block.text[name] = wrong
        return block

    def cells(self, names: Sequence[str]) -> Any:
        """Arrow table of whole columns, their cells as they are written. Raises TraceError."""
        import pyarrow as pa

        if self._bytes > LARGEST_TABLE:
            raise TraceError(f"{self.path}: more than {LARGEST_TABLE >> 20} MB to arrange; cut it")
        self.wanted, self._are_plain, parts = list(dict.fromkeys(names)), False, []
        while (raw := self._read_lines()) is not None:
            parts.append(self._read_csv(raw)[0])
        return pa.concat_tables(parts).rename_columns(self.wanted)

    def _read_lines(self) -> bytes | None:
        """Whole lines of about one block; at the end of the file whatever is left, then None."""
        while data := self._file.read(BLOCK_BYTES):
            lines, found, rest = data.rpartition(self._terminator)
            if found:
                lines, self._rest = self._rest + lines + found, rest
                return lines
            self._rest += data
            if len(self._rest) > LONGEST_LINE:
                raise TraceError(f"{self.path}: a line of more than {LONGEST_LINE} bytes")
        rest, self._rest = self._rest, b""
        return rest or None

    def _plain(self, raw: bytes) -> bytes:
        """The same cells in UTF-8 without quotes, which a broken row could spread over others."""
        if not raw.isascii():
            raw = _decoded(raw).encode()
        if b'"' in raw:
            delimiter = self._delimiter.encode()
            raw = _QUOTED.sub(lambda match: match[1].replace(delimiter, self._in_quotes), raw)
        if self._delimiter == SPACES:
            raw = _AT_ENDS.sub(b"", _SPACES.sub(b" ", raw))
        return raw

    def _read_csv(self, raw: bytes) -> tuple[Any, list[int]]:
        """Arrow table of the wanted columns, and the numbers (from 1) of rows that are ragged."""
        import pyarrow as pa
        from pyarrow import csv as arrow

        raw, ragged = self._plain(raw), list[int]()

        def skip(row: Any) -> str:
            ragged.append(row.number)
            return "skip"

        keys = [str(index) for index in range(len(self.names))]
        wanted = [keys[self.names.index(name)] for name in dict.fromkeys(self.wanted)]
        # Without threads the parser knows the number of a ragged row; block_size is one block.
        read = arrow.ReadOptions(column_names=keys, block_size=len(raw) + 1, use_threads=False)
        parse = arrow.ParseOptions(
            delimiter=self._delimiter, quote_char=False, invalid_row_handler=skip
        )
        more = {"strings_can_be_null": True, "decimal_point": self.decimal_point}
        types = dict.fromkeys(wanted, pa.float64() if self._are_plain else pa.large_binary())
        convert = arrow.ConvertOptions(column_types=types, include_columns=wanted, **more)
        try:
            table = arrow.read_csv(pa.BufferReader(raw), read, parse, convert)
        except pa.ArrowInvalid:
            if self._are_plain:
                self._are_plain = False
                return self._read_csv(raw)
            raise
        self.ragged_rows += len(ragged)
        return table, ragged

    def _read_layout(self, head: bytes) -> None:
        """Names, delimiter and first row, from the first bytes; TraceError if it is no trace."""
        path = self.path
        if not head.removeprefix(BYTE_ORDER_MARK).strip():
            raise TraceError(f"{path}: the file is empty; expected a header such as time_s,...")
        self._terminator = b"\n" if b"\n" in head else b"\r"
        lines = _lines(head, self._terminator)
        if lines[0].text[:4].lower() == "sep=":  # as Excel has it
            del lines[0]
        comments = [_Line(0, "")]
        while lines and (not lines[0].text or lines[0].text.startswith("#")):
            comments.append(lines.pop(0))
        if not lines:
            raise TraceError(f"{path}: holds comments only; expected a header such as time_s,...")
        if _CONTROL.search(lines[0].text):
            raise TraceError(f"{path}: line {len(comments)}: no text; expected names of columns")
        delimiter, top, first = _table(lines)
        is_scope = any(line.text.startswith(_SCOPE) for line in lines[top:_MOST_ABOVE])
        while is_scope and not _all_numbers(_split(lines[first].text, delimiter)[:1]):
            first += 1
        heading = [_split(line.text, delimiter) for line in lines[top:first]]
        rows = lines[first if top else 0 if top == first else 1 :]
        cells = [_split(row.text, delimiter) for row in rows[:_SAMPLE_LINES] if row.text]
        if is_scope:
            heading = [_of_scope(heading, cells[0][0])]
        names = heading[0] if heading else _split(comments[-1].text.lstrip("# "), delimiter)
        if not heading and len(names) != len(cells[0]):  # numpy.savetxt has its names in a comment
            names = [f"{BY_NUMBER}{column}" for column in range(1, len(cells[0]) + 1)]
        flat = [*itertools.chain.from_iterable(cells)]
        has_comma = delimiter != "," and any(map(_DECIMAL_COMMA.fullmatch, flat))
        wide = [row for row in cells if len(names) < len(row) <= 2 * len(names)]
        wide = [row for row in wide if all(map(_WHOLE.fullmatch, row))]
        if delimiter == "," and len(names) > 1 and cells and len(wide) == len(cells):
            raise TraceError(
                f"{path}: {len(names)} names above rows of {len(wide[0])} whole numbers: commas "
                "stand in the numbers and between them; expected decimal points, or semicolons "
                "between cells"
            )
        self._delimiter, self.decimal_point = delimiter, "," if has_comma else "."
        self._in_quotes = b"." if any(map(_QUOTED_COMMA.fullmatch, flat)) else b" "
        self.names, self.sample = _each_once(_fit_names(names, cells)), cells
        self.below = heading[1:]
        self._file.seek(rows[0].start if rows else len(head))


class _Line(NamedTuple):
    start: int
    text: str


def _table(lines: list[_Line]) -> tuple[str, int, int]:
    """Delimiter, number of the line with the names, and of the first below them with numbers.

    A table begins with two lines of as many cells, at least two of them numbers; the delimiter is
    the one that makes most of them numbers. Its names are the first of the lines above with as many
    cells; where these are numbers, both line numbers are the same.
    """
    best, found = 0.0, ("", 0, 1)
    for delimiter in (*_DELIMITERS[::-1], SPACES):
        rows = [_split(line.text, delimiter) for line in lines[:_MOST_ABOVE]]
        numbers = [sum(bool(cell) and _all_numbers([cell]) for cell in row) for row in rows]
        pairs = itertools.pairwise(zip(rows, numbers, strict=True))
        alike = [len(a) == len(b) and min(m, n) > 1 for (a, m), (b, n) in pairs]
        up = k = [*alike, True].index(True)
        width = len(rows[k])
        if k == len(alike) or numbers[k] / width <= best:
            continue
        while up and not lines[up - 1].text:
            up -= 1
        top = up
        while top and abs(len(rows[top - 1]) - width) <= 1:
            top -= 1
        if top == up and up and len(rows[up - 1]) > 1 and not numbers[up - 1]:
            top -= 1
        best = numbers[k] / width
        first = next(row for row in range(top, k + 1) if numbers[row])
        found = delimiter, top, max(first, top + 1 - _all_numbers(rows[top]))
    if best:
        return found
    delimiter = max(_DELIMITERS, key=lambda each: len(_split(lines[0].text, each)))
    return delimiter, 0, int(not _all_numbers(_split(lines[0].text, delimiter)))


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names that are there twice, with the number of their column."""
    twice = {name for name, count in Counter(names).items() if count > 1 and name}
    numbered = enumerate(names, start=1)
    return tuple(f"{name} {BY_NUMBER}{k}" if name in twice else name for k, name in numbered)


def _of_scope(heading: list[list[str]], first: str) -> list[str]:
    """Names in an export of a TwinCAT Scope: its header has a key before each of its values."""
    said = {row[0]: row[1::2] for row in heading if row}
    time_unit, names = "ms" if len(first) < _TICKS_LENGTH else "100 ns", []
    for name, unit in itertools.zip_longest(said["Name"], said.get("Unit", ()), fillvalue=""):
        unit = unit.partition("(")[0].strip()  # noqa: PLW2901
        names += [f"Time {name} [{time_unit}]", f"{name} [{unit}]" if unit else name]
    return names


def _decoded(raw: bytes) -> str:
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # as older data loggers write units


def _lines(head: bytes, terminator: bytes) -> list[_Line]:
    start = len(BYTE_ORDER_MARK) if head.startswith(BYTE_ORDER_MARK) else 0
    lines = []
    for raw in head[start:].split(terminator):
        lines.append(_Line(start, _decoded(raw).strip(" \r\n")))
        start += len(raw) + len(terminator)
    return lines


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == SPACES:
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        return [line]
    return [cell.strip() for cell in cells]


def _all_numbers(cells: list[str]) -> bool:
    try:
        for cell in filter(None, cells):
            float(_PARTED.sub("", cell).translate(_AS_PYTHON))
    except ValueError:
        return False
    return not any(cell.lower() in {"nan", "inf"} for cell in cells)


def _fit_names(names: list[str], rows: list[list[str]]) -> tuple[str, ...]:
    """Add or drop one empty name where header and rows differ by a trailing delimiter."""
    width = Counter(len(row) for row in rows or [names]).most_common(1)[0][0]
    if width == len(names) + 1 and all(not row[-1] for row in rows if len(row) == width):
        return (*names, "")
    if width == len(names) - 1 and not names[-1]:
        return tuple(names[:-1])
    return tuple(names)
