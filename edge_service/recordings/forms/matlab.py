"""Tables in MATLAB files of version 5 (`save -v6`, `-v7`): columns by name.

A column is a vector of numbers: a variable, a field of a struct, or a column of a matrix that a
variable of names (char rows or a cell of strings) of the same width stands beside. The columns are
those of the length that most of them have. MATLAB's own `table` and `timetable` are objects that
nothing but MATLAB can read; version 7.3 is HDF5.
"""

import json
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...limited_process import ProcessLimits, limited_command, why_it_ended
from ...messages.samples import Floats
from ..block import Block, number_rows
from ..columns import TraceError
from .form import Form

MAGIC = b"MATLAB 5.0 MAT-file"
BLOCK_ROWS = 1 << 14
LARGEST_BYTES = 1 << 28
"""Of all variables together, unpacked."""
_HEADER_BYTES, _TAG_BYTES, _COMPRESSED = 128, 8, 15
LIMITS = ProcessLimits(memory_mb=2000.0, cpu_s=120.0)
LONGEST_S = 180.0
_CHUNK = 1 << 20


class MatlabSource:
    """The table of a file, which a process of its own unpacks: damaged ones can end loadmat."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ragged_rows = 0
        self._wanted: list[str] = []
        self._start = 0
        _check_size(path)
        self._unpacked = tempfile.TemporaryFile()  # noqa: SIM115  # open as long as the source
        try:
            self._head = self._unpack()
        except BaseException:
            self._unpacked.close()
            raise
        self.names = tuple(self._head["columns"])
        self._rows, self._first = int(self._head["rows"]), self._unpacked.tell()
        other = self._head["other"]
        self.remarks = (f"of another length: {', '.join(other[:12])}",) if other else ()

    def _unpack(self) -> dict[str, Any]:
        """Let a process write the columns; what it says of them. Raises TraceError and OSError."""
        command = [sys.executable, "-m", "edge_service.recordings.matlab_process", str(self.path)]
        try:
            ended = subprocess.run(
                limited_command(command, LIMITS, dies_with_caller=False),
                stdin=subprocess.DEVNULL,
                stdout=self._unpacked,
                stderr=subprocess.DEVNULL,
                check=False,
                timeout=LONGEST_S,
            )
        except subprocess.TimeoutExpired:
            raise TraceError(f"{self.path}: not unpacked within {LONGEST_S:g} s") from None
        self._unpacked.seek(0)
        line = self._unpacked.readline()
        if ended.returncode != 0 or not line:
            why = why_it_ended(ended.returncode, LIMITS) or "the process ended"
            raise TraceError(f"{self.path}: a damaged MATLAB file ({why})")
        head: dict[str, Any] = json.loads(line)
        if "error" in head:
            raise TraceError(f"{self.path}: {head['error']}")
        return head

    @property
    def fraction_read(self) -> float:
        """Fraction of the table that has been read, 0 to 1."""
        return self._start / max(self._rows, 1)

    def holds_numbers(self, name: str) -> bool:
        """Every column does."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = names

    def close(self) -> None:
        """Let go of the table; safe twice."""
        self._unpacked.close()

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises OSError."""
        rows = min(BLOCK_ROWS, self._rows - self._start)
        if rows <= 0:
            return None
        values = {name: self._part(self.names.index(name), rows) for name in self._wanted}
        number = number_rows(self._start, rows)
        self._start += rows
        return Block(values, number)

    def _part(self, column: int, rows: int) -> Floats:
        self._unpacked.seek(self._first + 8 * (column * self._rows + self._start))
        values: Floats = np.frombuffer(self._unpacked.read(8 * rows))
        return values


def _check_size(path: Path) -> None:
    """Refuse a file that unpacks to more than it may take, before anything keeps it."""
    size, whole = 0, path.stat().st_size
    with path.open("rb") as file:
        swapped = file.read(_HEADER_BYTES)[126:128] == b"MI"
        while tag := file.read(_TAG_BYTES):
            kind, length = (
                int.from_bytes(each, "big" if swapped else "little") for each in (tag[:4], tag[4:])
            )
            if len(tag) < _TAG_BYTES or file.tell() + length > whole:
                raise TraceError(f"{path}: a truncated or damaged MATLAB file")
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


FORM = Form(
    "MATLAB 5",
    lambda head, _path: head.startswith(MAGIC),
    lambda path, _axis: MatlabSource(path),
)
