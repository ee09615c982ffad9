"""Unpacks the table of a MATLAB file: a line of JSON, then its columns as doubles.

python -m edge_service.recordings.matlab_process FILE
"""

import json
import sys
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatlabFunction, MatlabOpaque, MatReadError

from ..messages.samples import Floats

_BROKEN = (
    *(ValueError, TypeError, KeyError, IndexError, AttributeError, EOFError, OSError, MemoryError),
    *(NotImplementedError, ArithmeticError, RecursionError, zlib.error, MatReadError),
)
"""Errors that loadmat raises on a damaged file."""
_AS_CSV = "write it with writetimetable(T, 'x.csv') or writetable(T, 'x.csv')"
_MOST_COLUMNS = 4096


def unpack(path: Path, out: BinaryIO) -> None:
    """Write the table of a file, or why there is none."""
    try:
        variables = loadmat(path, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
        columns, objects = _columns_of(variables)
    except _BROKEN as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        _line(out, {"error": f"a truncated or damaged MATLAB file ({reason})"})
        return
    table = _of_one_length(columns)
    if not table:
        what = "a table or timetable object, which only MATLAB reads" if objects else "no column"
        hint = _AS_CSV if objects else "expected vectors of numbers"
        _line(out, {"error": f"holds {what}; {hint}"})
        return
    rows = len(next(iter(table.values())))
    other = [name for name in columns if name not in table]
    _line(out, {"columns": list(table), "rows": rows, "other": other})
    for values in table.values():
        out.write(np.ascontiguousarray(values, dtype=np.float64).tobytes())


def _line(out: BinaryIO, values: Mapping[str, Any]) -> None:
    out.write(json.dumps(values).encode() + b"\n")


def _columns_of(variables: Mapping[str, Any]) -> tuple[dict[str, Floats], bool]:
    """Every column of numbers by name, and whether there are objects that nobody can read."""
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


if __name__ == "__main__":
    unpack(Path(sys.argv[1]), sys.stdout.buffer)
