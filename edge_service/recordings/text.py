"""Rows of a text file, block by block, and its layout: delimiter, decimal point, column names."""

import csv
import itertools
import re
from collections import Counter
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from .columns import BY_NUMBER, TraceError
from .source import BYTE_ORDER_MARK, MOST_COLUMNS, Block, Source, floats_from_text

BLOCK_BYTES = 1 << 19
LONGEST_LINE = 1 << 22
SPACES = " "
"""Any number of spaces."""
_ASCII = bytes(range(128)) + b"?" * 128
_SPACES, _AT_ENDS = re.compile(rb"[ \t]+"), re.compile(rb"^ | (?=\r?$)", re.MULTILINE)
_QUOTED = re.compile(rb'"([^"\r\n]*)"')
_DELIMITERS = (",", ";", "\t")
_SURE = ("\t", ";")
_SAMPLE_LINES = 20
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\ufffd]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
_WHOLE = re.compile(r"[+-]?\d+([eE][+-]?\d+)?")


class TextSource(Source):
    """An open CSV file. Cells that are no numbers become NaN, ragged rows are counted."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self._rest = b""
        self._read_layout(file.read(BLOCK_BYTES))
        if len(self.names) > MOST_COLUMNS:
            raise TraceError(f"{path}: more than {MOST_COLUMNS} columns")

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        raw = self._read_lines()
        if raw is None:
            return None
        import pyarrow as pa

        raw = self._plain(raw)
        try:
            table, ragged = self._read_csv(raw, pa.float64())
        except pa.ArrowInvalid:
            table, ragged = self._read_csv(raw, pa.large_binary())
        rows = table.num_rows + len(ragged)
        number = self._number_rows(rows)
        if ragged:
            number = np.delete(number, [min(row, rows) - 1 for row in ragged])
        self.ragged_rows += len(ragged)
        block = Block({}, number)
        for name, column in zip(dict.fromkeys(self.wanted), table.columns, strict=True):
            if column.type == pa.float64():
                block.values[name] = column.to_numpy()
                continue
            block.values[name], wrong = floats_from_text(column, self._decimal_point)
            if wrong is not None:
                block.text[name] = wrong
        return block

    def _read_lines(self) -> bytes | None:
        """Whole lines of about one block; at the end of the file whatever is left, then None."""
        while data := self._file.read(BLOCK_BYTES):
            lines, found, rest = data.rpartition(self._terminator)
            if found:
                lines = self._rest + lines + found
                self._rest = rest
                return lines
            self._rest += data
            if len(self._rest) > LONGEST_LINE:
                raise TraceError(f"{self.path}: a line of more than {LONGEST_LINE} bytes")
        rest, self._rest = self._rest, b""
        return rest or None

    def _plain(self, raw: bytes) -> bytes:
        """The same cells in ASCII without quotes, which a broken row could spread over others."""
        if not raw.isascii():
            raw = raw.translate(_ASCII)
        if b'"' in raw:
            delimiter = self._delimiter.encode()
            raw = _QUOTED.sub(lambda match: match[1].replace(delimiter, b" "), raw)
        if self._delimiter == SPACES:
            raw = _AT_ENDS.sub(b"", _SPACES.sub(b" ", raw))
        return raw

    def _read_csv(self, raw: bytes, cell_type: Any) -> tuple[Any, list[int]]:
        """Arrow table of the wanted columns, and the row numbers (from 1) of the ragged rows."""
        import pyarrow as pa
        import pyarrow.csv

        ragged: list[int] = []

        def skip(row: Any) -> str:
            ragged.append(row.number)
            return "skip"

        keys = [str(index) for index in range(len(self.names))]
        wanted = [keys[self.names.index(name)] for name in dict.fromkeys(self.wanted)]
        table = pyarrow.csv.read_csv(
            pa.BufferReader(raw),
            # Without threads the parser knows the number of a ragged row; block_size is one block.
            read_options=pyarrow.csv.ReadOptions(
                column_names=keys, block_size=len(raw) + 1, use_threads=False
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=self._delimiter, quote_char=False, invalid_row_handler=skip
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(wanted, cell_type),
                include_columns=wanted,
                decimal_point=self._decimal_point,
                strings_can_be_null=True,
            ),
        )
        return table, ragged

    def _read_layout(self, head: bytes) -> None:
        """Names, delimiter and first row, from the first bytes; TraceError if it is no trace."""
        path = self.path
        if not head.removeprefix(BYTE_ORDER_MARK).strip():
            raise TraceError(f"{path}: the file is empty; expected a header such as time_s,...")
        self._terminator = b"\n" if b"\n" in head else b"\r"
        lines = _lines(head, self._terminator)
        comments = []
        while lines and (not lines[0].text or lines[0].text.startswith("#")):
            comments.append(lines.pop(0))
        if not lines:
            what = "comments only" if comments else "no line of text"
            raise TraceError(f"{path}: holds {what}; expected a header such as time_s,...")
        delimiter, names, rows = _names_and_rows(path, comments, lines)
        cells = [_split(row.text, delimiter) for row in rows[:_SAMPLE_LINES] if row.text]
        flat = itertools.chain.from_iterable(cells)
        has_comma = delimiter != "," and any(map(_DECIMAL_COMMA.fullmatch, flat))
        wide = [row for row in cells if len(names) < len(row) <= 2 * len(names)]
        wide = [row for row in wide if all(map(_WHOLE.fullmatch, row))]
        if delimiter == "," and len(names) > 1 and cells and len(wide) == len(cells):
            raise TraceError(
                f"{path}: {len(names)} names above rows of {len(wide[0])} whole numbers: commas "
                "stand in the numbers and between them; expected decimal points, or semicolons "
                "between cells"
            )
        self._delimiter, self._decimal_point = delimiter, "," if has_comma else "."
        self.names = _fit_names(names, cells)
        self._file.seek(rows[0].start if rows else len(head))


class _Line(NamedTuple):
    number: int
    start: int
    text: str


def _lines(head: bytes, terminator: bytes) -> list[_Line]:
    """The lines of `head` with their positions."""
    start = len(BYTE_ORDER_MARK) if head.startswith(BYTE_ORDER_MARK) else 0
    lines = []
    for number, raw in enumerate(head[start:].split(terminator), start=1):
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")  # as older data loggers write units
        lines.append(_Line(number, start, text.strip(" \r\n")))
        start += len(raw) + len(terminator)
    return lines


def _names_and_rows(
    path: Path, comments: list[_Line], lines: list[_Line]
) -> tuple[str, list[str], list[_Line]]:
    """Delimiter, names, and the lines below them.

    Some programs (numpy.savetxt) write the names as a comment: the last comment is the header if
    the first line below holds as many numbers. Columns without any name go by their number.
    """
    first = lines[0]
    if _CONTROL.search(first.text):
        raise TraceError(f"{path}: line {first.number}: no text; expected a header of column names")
    delimiter, cells = _cells(first.text, lines[1].text if len(lines) > 1 else "")
    if not _all_numbers(cells):
        return delimiter, cells, lines[1:]
    if comments and comments[-1].text:
        names = _split(comments[-1].text.lstrip("# "), delimiter)
        if len(names) == len(cells):
            return delimiter, names, lines
    return delimiter, [f"{BY_NUMBER}{column}" for column in range(1, len(cells) + 1)], lines


def _cells(line: str, below: str) -> tuple[str, list[str]]:
    """Delimiter and cells of the first line: the delimiter that gives the most cells.

    Between numbers a comma may also be the decimal point: any other delimiter comes first. Spaces
    part words within a name, too: they are the delimiter if nothing else is, and of numbers only.
    """
    cells = {delimiter: _split(line, delimiter) for delimiter in (*_DELIMITERS, SPACES)}
    for delimiter in _SURE:
        if len(cells[delimiter]) > 1 and _all_numbers(cells[delimiter]):
            return delimiter, cells[delimiter]
    delimiter = max(_DELIMITERS, key=lambda delimiter: len(cells[delimiter]))
    row = cells[SPACES] if _all_numbers(cells[SPACES]) else _split(below, SPACES)
    if len(cells[delimiter]) == 1 < len(cells[SPACES]) == len(row) and _all_numbers(row):
        return SPACES, cells[SPACES]
    return delimiter, cells[delimiter]


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
            float(cell.replace(",", "."))
    except ValueError:
        return False
    return not any(cell.lower() in {"nan", "inf"} for cell in cells)


def _fit_names(names: list[str], rows: list[list[str]]) -> tuple[str, ...]:
    """Add or drop one empty name where header and rows differ by a trailing delimiter."""
    if not rows:
        return tuple(names)
    width = Counter(len(row) for row in rows).most_common(1)[0][0]
    if width == len(names) + 1 and all(not row[-1] for row in rows if len(row) == width):
        return (*names, "")
    if width == len(names) - 1 and not names[-1]:
        return tuple(names[:-1])
    return tuple(names)
