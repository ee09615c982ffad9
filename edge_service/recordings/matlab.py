"""Tables in MATLAB files of version 5 (`save -v6`, `-v7`): columns by name.

A column is a vector of numbers: a variable, a field of a struct, or a column of a matrix, by the
names in a cell beside it, else #1, #2, ... The columns are those of the length that most have.
MATLAB's own `table` and `timetable` are objects that nothing but MATLAB can read; version 7.3 is
HDF5. Layout: MathWorks, "MAT-File Level 5 Format".
"""

import math
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from .columns import BY_NUMBER, TraceError
from .source import MOST_COLUMNS, TableSource

MAGIC = b"MATLAB 5.0 MAT-file"
LARGEST_BYTES = 1 << 28
"""Of all variables together, unpacked."""
DEEPEST = 16
_HEADER_BYTES, _MATRIX, _COMPRESSED = 128, 14, 15
_NUMBERS = dict(enumerate(["i1", "u1", "i2", "u2", "i4", "u4", "f4"], start=1))
_NUMBERS |= {9: "f8", 12: "i8", 13: "u8", 16: "u1", 17: "u2", 18: "u4"}  # the last of characters
_CELL, _STRUCT, _CHAR, _FIRST_NUMERIC, _LAST_NUMERIC = 1, 2, 4, 6, 15
_OBJECTS, _OPAQUE = {3, 16, 17}, 17
_COMPLEX = 0x800
_NO_COLUMN = "no column; expected vectors of numbers"
_AN_OBJECT = (
    "a table or timetable object, which only MATLAB reads; write it with "
    "writetimetable(T, 'x.csv') or writetable(T, 'x.csv')"
)
_OBJECT = object()
Numbers = npt.NDArray[Any]


class MatlabSource(TableSource):
    """The table of a file. Numbers stay as they are packed until their rows are read."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        try:
            variables = dict(_variables(path, file))
        except (ValueError, IndexError, KeyError, struct.error, zlib.error) as error:
            reason = " ".join(str(error).split())[:100] or type(error).__name__
            raise TraceError(f"{path}: a truncated or damaged MATLAB file ({reason})") from None
        columns: dict[str, Numbers] = {}
        for name, value in variables.items():
            columns |= _columns_in(name, value, variables)
        columns = dict(list(columns.items())[:MOST_COLUMNS])
        lengths = Counter(len(values) for values in columns.values())
        if not lengths:
            objects = any(value is _OBJECT for value in variables.values())
            raise TraceError(f"{path}: holds {_AN_OBJECT if objects else _NO_COLUMN}")
        length = max(lengths, key=lambda each: (lengths[each], each))
        table = {name: each for name, each in columns.items() if len(each) == length}
        super().__init__(path, file, table)
        if others := [name for name in columns if name not in self.names]:
            self.notes.append(f"of another length: {', '.join(others[:12])}")


def _variables(path: Path, file: IO[bytes]) -> Iterator[tuple[str, Any]]:
    """Variables of a file by name, unpacked within bounds."""
    order = ">" if file.read(_HEADER_BYTES)[126:128] == b"MI" else "<"
    whole = file.seek(0, 2)
    position, unpacked = _HEADER_BYTES, 0
    while position < whole:
        file.seek(position)
        tag = file.read(8)
        kind, size = struct.unpack(f"{order}II", tag)
        position += 8 + size
        if position > whole:
            raise ValueError("a length beyond the end of the file")
        packed, unpacker = kind == _COMPRESSED, zlib.decompressobj()
        if packed:  # the tag inside says how much it unpacks to
            tag = unpacker.decompress(file.read(min(size, LARGEST_BYTES)), 8)
            kind, size = struct.unpack(f"{order}II", tag)
        unpacked += size
        if unpacked > LARGEST_BYTES:
            raise TraceError(f"{path}: unpacks to more than {LARGEST_BYTES >> 20} MB")
        if size == 0:
            continue
        rest = unpacker.decompress(unpacker.unconsumed_tail, size) if packed else file.read(size)
        kind, matrix, _ = _element(tag + rest, 0, order)
        if kind == _MATRIX:
            name, value = _matrix(matrix, order, 0)
            if name and not name.startswith("__"):
                yield name, value


def _element(content: memoryview | bytes, at: int, order: str) -> tuple[int, memoryview, int]:
    """Type and data of the element that begins somewhere, and where the next one begins."""
    kind, size = struct.unpack_from(f"{order}II", content, at)
    start = at + 8
    if kind >> 16:  # a small one, whose data stand in its tag
        kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
    if start + size > len(content) or (start == at + 4 and size > 4):
        raise ValueError("an element beyond its end")
    following = at + 8 if start == at + 4 else start + size + -size % 8
    return kind, memoryview(content)[start : start + size], following


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Name and value: an array, a text, a list of a cell's values, a dict of a struct's.

    None stands for what holds no column, `_OBJECT` for an object. Raises ValueError, IndexError,
    KeyError or struct.error for damage.
    """
    if depth > DEEPEST:
        raise ValueError(f"variables more than {DEEPEST} deep")
    if not len(content):
        return "", None
    _, flags, at = _element(content, 0, order)
    flag = struct.unpack_from(f"{order}I", flags)[0]
    kind, shape = flag & 0xFF, ()
    if kind != _OPAQUE:
        _, dims, at = _element(content, at, order)
        shape = tuple(np.frombuffer(dims, f"{order}u4").tolist())
    _, raw, at = _element(content, at, order)
    name = bytes(raw).decode("latin-1")
    value: Any = None
    if kind in _OBJECTS:
        value = _OBJECT
    elif kind == _CHAR or _FIRST_NUMERIC <= kind <= _LAST_NUMERIC:
        stored, data, _ = _element(content, at, order)
        values = np.frombuffer(data, f"{order}{_NUMBERS[stored]}")
        if kind == _CHAR:
            value = "".join(map(chr, values.tolist())) if values.max(initial=0) < 1 << 16 else None
        elif not flag & _COMPLEX:
            value = values.reshape(shape, order="F")
    elif kind == _STRUCT and math.prod(shape) == 1:
        _, data, at = _element(content, at, order)
        width = struct.unpack_from(f"{order}i", data)[0]
        _, data, at = _element(content, at, order)
        if width <= 0 or len(data) > width * MOST_COLUMNS:
            raise ValueError(f"{name[:40]}: names of fields")
        texts = [bytes(data[start : start + width]) for start in range(0, len(data), width)]
        value = {}
        for text in texts:
            _, data, at = _element(content, at, order)
            value[text.partition(b"\0")[0].decode("latin-1")] = _matrix(data, order, depth + 1)[1]
    elif kind == _CELL and math.prod(shape) <= MOST_COLUMNS:
        value = []
        for _ in range(math.prod(shape)):
            _, data, at = _element(content, at, order)
            value.append(_matrix(data, order, depth + 1)[1])
    return name, value


def _columns_in(name: str, value: Any, beside: Mapping[str, Any]) -> dict[str, Numbers]:
    """Columns of a variable: a vector, a matrix with its names, a struct of such."""
    if isinstance(value, dict):
        columns: dict[str, Numbers] = {}
        for field, each in value.items():
            columns |= _columns_in(field, each, value)
        return columns
    if not isinstance(value, np.ndarray) or value.ndim != 2 or value.size < 2:
        return {}
    if 1 in value.shape:
        return {name: value.ravel()}
    width = value.shape[1]
    names = [f"{BY_NUMBER}{column}" for column in range(1, min(width, MOST_COLUMNS) + 1)]
    for each in beside.values():
        cells = each if isinstance(each, list) else []
        texts = [cell.strip() if isinstance(cell, str) else "" for cell in cells]
        if len(texts) == width == len(set(texts)) and all(texts):
            names = texts
            break
    return {each: value[:, column] for column, each in enumerate(names)}
