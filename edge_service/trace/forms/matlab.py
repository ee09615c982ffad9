"""Tables in MATLAB files of version 5 (`save -v6`, `-v7`): columns by name.

A column is a vector of numbers: a variable, a field of a struct, or a column of a matrix that a
variable of names (char rows or a cell of strings) of the same width stands beside. The columns are
those of the length that most of them have. MATLAB's own `table` and `timetable` are objects that
nothing but MATLAB can read; version 7.3 is HDF5.
"""

import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...messages.samples import Floats
from ..block import Block, number_rows
from ..columns import TraceError
from .form import Form

MAGIC = b"MATLAB 5.0 MAT-file"
BLOCK_ROWS = 1 << 14
LARGEST_BYTES = 1 << 28
"""Of all variables together, unpacked."""
_HEADER_BYTES, _TAG_BYTES, _COMPRESSED = 128, 8, 15
_MOST_COLUMNS, _CHUNK = 4096, 1 << 20
_BROKEN = (
    *(ValueError, TypeError, KeyError, IndexError, AttributeError, EOFError, OSError, MemoryError),
    *(NotImplementedError, OverflowError, RecursionError, zlib.error),
)
"""What loadmat raises on a damaged file, beside its own."""
_AS_CSV = "write it with writetimetable(T, 'x.csv') or writetable(T, 'x.csv')"


class MatlabSource:
    """The table of a file, which is read whole."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ragged_rows = 0
        self._wanted: list[str] = []
        self._start = 0
        _check_size(path)
        columns, objects = _columns_of(_loaded(path))
        self._columns = _of_one_length(columns)
        if not self._columns:
            what = (
                "a table or timetable object, which only MATLAB reads" if objects else "no column"
            )
            hint = _AS_CSV if objects else "expected vectors of numbers"
            raise TraceError(f"{path}: holds {what}; {hint}")
        self._rows = len(next(iter(self._columns.values())))
        self.names = tuple(self._columns)
        other = [name for name in columns if name not in self._columns]
        self.remarks = (f"of another length: {', '.join(other[:12])}",) if other else ()

    @property
    def fraction_read(self) -> float:
        """Fraction of the table that has been read, 0 to 1."""
        return self._start / max(self._rows, 1)

    def holds_numbers(self, name: str) -> bool:
        """Every column does."""
        return name in self._columns

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = names

    def close(self) -> None:
        """Let go of the table; safe twice."""
        self._start = self._rows

    def read_block(self) -> Block | None:
        """The next rows, or None at the end."""
        rows = min(BLOCK_ROWS, self._rows - self._start)
        if rows <= 0:
            return None
        part = slice(self._start, self._start + rows)
        number = number_rows(self._start, rows)
        self._start += rows
        return Block({name: self._columns[name][part] for name in self._wanted}, number)


def _loaded(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        return dict(loadmat(path, squeeze_me=False, struct_as_record=True, chars_as_strings=True))
    except (*_BROKEN, MatReadError) as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise TraceError(f"{path}: a truncated or damaged MATLAB file ({reason})") from None


def _check_size(path: Path) -> None:
    """Refuse a file that unpacks to more than it may take, before anything keeps it."""
    size = 0
    with path.open("rb") as file:
        swapped = file.read(_HEADER_BYTES)[126:128] == b"MI"
        while len(tag := file.read(_TAG_BYTES)) == _TAG_BYTES:
            kind, length = (
                int.from_bytes(each, "big" if swapped else "little") for each in (tag[:4], tag[4:])
            )
            if kind == _COMPRESSED:
                size += _unpacked(file, length)
            else:
                size += length
                file.seek(length, 1)
            if size > LARGEST_BYTES:
                raise TraceError(f"{path}: unpacks to more than {LARGEST_BYTES >> 20} MB")


def _unpacked(file: BinaryIO, length: int) -> int:
    """Bytes that a packed variable of a length holds, counted without keeping them."""
    unpacker, count, end = zlib.decompressobj(), 0, file.tell() + length
    while count <= LARGEST_BYTES and (packed := file.read(min(_CHUNK, end - file.tell()))):
        try:
            while packed and count <= LARGEST_BYTES:
                count += len(unpacker.decompress(packed, _CHUNK))
                packed = unpacker.unconsumed_tail
        except zlib.error:
            break  # whoever reads it says what is wrong
    file.seek(end)
    return count


def _columns_of(variables: Mapping[str, Any]) -> tuple[dict[str, Floats], bool]:
    """Every column of numbers by name, and whether there are objects that nobody can read."""
    from scipy.io.matlab import MatlabFunction, MatlabOpaque

    columns: dict[str, Floats] = {}
    objects = False
    for name, value in variables.items():
        if isinstance(value, (MatlabOpaque, MatlabFunction)):
            objects = True
        elif not name.startswith("__"):
            columns |= _columns_in(name, value, variables)
    return dict(list(columns.items())[:_MOST_COLUMNS]), objects


def _columns_in(name: str, value: Any, beside: Mapping[str, Any]) -> dict[str, Floats]:
    """Columns of a variable: a vector, a matrix with its names, a struct of such."""
    if not isinstance(value, np.ndarray):
        return {}
    if value.dtype.names is not None:
        return _columns_of_struct(value)
    if value.ndim != 2 or value.dtype.kind not in "biuf":
        return {}
    if 1 in value.shape:
        return {name: value.ravel().astype(np.float64)} if value.size > 1 else {}
    names = _names_for(value.shape[1], beside) or [
        f"{name}_{column}" for column in range(1, value.shape[1] + 1)
    ]
    matrix = value.astype(np.float64)
    return {each: matrix[:, column] for column, each in enumerate(names[:_MOST_COLUMNS])}


def _columns_of_struct(value: Any) -> dict[str, Floats]:
    if value.size != 1:
        return {}
    record = value.ravel()[0]
    fields = {field: record[field] for field in value.dtype.names}
    columns: dict[str, Floats] = {}
    for field, each in fields.items():
        columns |= _columns_in(field, each, fields)
    return columns


def _names_for(width: int, beside: Mapping[str, Any]) -> list[str] | None:
    """Names for the columns of a matrix: of a variable that holds so many different ones."""
    for value in beside.values():
        names = list(_texts(value))
        if len(names) == width == len(set(names)) and all(names):
            return names
    return None


def _texts(value: Any) -> Iterator[str]:
    """Texts in a char matrix or in a cell of strings."""
    if not isinstance(value, np.ndarray):
        return
    for cell in value.ravel()[:_MOST_COLUMNS]:
        text = cell.ravel()[0] if isinstance(cell, np.ndarray) and cell.size == 1 else cell
        if not isinstance(text, str):
            return
        yield text.strip()


def _of_one_length(columns: Mapping[str, Floats]) -> dict[str, Floats]:
    """The columns of the length that most of them have, the longer one of two alike."""
    lengths = Counter(len(values) for values in columns.values())
    if not lengths:
        return {}
    length = max(lengths, key=lambda each: (lengths[each], each))
    return {name: values for name, values in columns.items() if len(values) == length}


FORM = Form(
    "MATLAB 5",
    lambda head, _path: head.startswith(MAGIC),
    lambda path, _axis: MatlabSource(path),
)
