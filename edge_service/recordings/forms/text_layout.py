"""Layout of a text file, read from its top: delimiter, decimal point, column names."""

import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from ..columns import BY_NUMBER, TraceError
from .foreign import BYTE_ORDER_MARK

_DELIMITERS = (",", ";", "\t")
_SURE = ("\t", ";")
SPACES = " "
"""Any number of spaces."""
_SAMPLE_LINES = 20
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\ufffd]")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a text file.

    Attributes:
        names: one name per cell of a row; empty where the file gives none.
        delimiter: between two cells.
        decimal_point: inside a number.
        terminator: end of a line.
        start: position of the first byte after the header, or of the first row.
    """

    names: tuple[str, ...]
    delimiter: str
    decimal_point: str
    terminator: bytes
    start: int


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    start: int
    text: str


def read_layout(path: Path, head: bytes) -> Layout:
    """Layout of a text file whose first bytes are `head`; TraceError if it is no trace."""
    _refuse_empty(path, head)
    terminator = b"\n" if b"\n" in head else b"\r"
    lines = _lines(head, terminator)
    comments = []
    while lines and (not lines[0].text or lines[0].text.startswith("#")):
        comments.append(lines.pop(0))
    if not lines and not comments:
        raise TraceError(f"{path}: holds no line of text; expected a header such as time_s,...")
    delimiter, names, rows = _names_and_rows(path, comments, lines)
    cells = [_split(row.text, delimiter) for row in rows[:_SAMPLE_LINES] if row.text]
    if delimiter == ",":
        _refuse_decimal_commas(path, len(names), cells)
    start = rows[0].start if rows else len(head)
    point = _decimal_point(delimiter, cells)
    return Layout(_fit_names(names, cells), delimiter, point, terminator, start)


def _refuse_empty(path: Path, head: bytes) -> None:
    if not head.removeprefix(BYTE_ORDER_MARK).strip():
        raise TraceError(f"{path}: the file is empty; expected a header such as time_s,...")


def _lines(head: bytes, terminator: bytes) -> list[_Line]:
    """The lines of `head` with their positions."""
    start = len(BYTE_ORDER_MARK) if head.startswith(BYTE_ORDER_MARK) else 0
    lines = []
    for number, raw in enumerate(head[start:].split(terminator), start=1):
        lines.append(_Line(number, start, _decode(raw).strip(" \r\n")))
        start += len(raw) + len(terminator)
    return lines


def _decode(raw: bytes) -> str:
    """UTF-8, or Latin-1 as older data loggers write units."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _names_and_rows(
    path: Path, comments: list[_Line], lines: list[_Line]
) -> tuple[str, list[str], list[_Line]]:
    """Delimiter, names, and the lines below them.

    Some programs (numpy.savetxt) write the names as a comment: the last comment is the header if
    the first line below holds as many numbers. Columns without any name go by their number.
    """
    if not lines:
        raise TraceError(f"{path}: holds comments only; expected a header such as time_s,...")
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
    return all(_is_number(cell) for cell in cells if cell)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return cell.lower() not in {"nan", "inf"}


def _decimal_point(delimiter: str, rows: list[list[str]]) -> str:
    """A comma if the cells cannot be parted by it and some number holds one."""
    if delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row):
        return ","
    return "."


def _refuse_decimal_commas(path: Path, names: int, rows: list[list[str]]) -> None:
    """Refuse whole numbers, up to twice as many as names: commas part digits and cells alike."""
    wide = [row for row in rows if names < len(row) <= 2 * names and _are_whole(row)]
    if rows and len(wide) == len(rows) and names > 1:
        raise TraceError(
            f"{path}: {names} names above rows of {len(wide[0])} whole numbers: commas stand in "
            "the numbers and between them; expected decimal points, or semicolons between cells"
        )


def _are_whole(cells: list[str]) -> bool:
    return all(re.fullmatch(r"[+-]?\d+([eE][+-]?\d+)?", cell) for cell in cells)


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
