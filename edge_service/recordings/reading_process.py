"""Reading of a stranger's trace in a process of its own: what it asks for cannot harm the service.

A small file may hold gigabytes. The process has bounds of memory and time; what it sends are frames
of bounded size, so neither its content nor its end touches the process that reads.
"""

import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from ..limited_process import ProcessLimits, limited_command, why_it_ended
from ..messages.channels import CHANNELS, TIME
from ..messages.samples import SampleFrame
from .columns import ColumnLike, ColumnMap, TraceError
from .reader import open_trace
from .sinumerik.controller_axis import ControllerAxis

READ_LIMITS = ProcessLimits(memory_mb=1000.0, cpu_s=3600.0)
PATIENCE_S = 60.0
"""Longest wait for the next frame, s."""
MOST_ROWS = 1 << 20
"""Rows of a frame; more are no frame of ours."""
ROWS_AT_ONCE = 1 << 11
"""Rows that are sent in one frame: an axis that follows a recording holds two of them."""
_LONGEST_HEAD = 1 << 16
_ITEM_BYTES = 8


class ReadingProcess:
    """An open trace, as TraceReader, that is read elsewhere.

    Args:
        path: the file.
        columns: see open_trace.
        axis: see open_trace.
        skip_rows: leave out so many rows at the beginning.

    Raises:
        TraceError: as open_trace, and for a file that asks for more than it may take.
        OSError: no process can be started now.
    """

    def __init__(
        self,
        path: Path,
        columns: Mapping[str, ColumnLike] | None = None,
        axis: ControllerAxis | None = None,
        *,
        skip_rows: int = 0,
        limits: ProcessLimits = READ_LIMITS,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.path = path
        self.rows_read, self.ragged_rows = 0, 0
        self.bad_cells: dict[str, int] = {}
        self._limits, self._patience_s = limits, patience_s
        self._closing = threading.Lock()
        self._buffer = bytearray()
        request = _request(path, columns or {}, axis or ControllerAxis(), skip_rows)
        self._closed = False
        self._process = _started(request, limits)
        try:
            self.channels = self._opened()
        except BaseException:
            self.release()
            raise

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> SampleFrame:
        """The next frame. Raises TraceError, StopIteration at the end or once it is closed."""
        try:
            head = self._head()
            if head.get("end"):
                raise StopIteration
            return self._frame(head)
        except TraceError:
            if self._closed:
                raise StopIteration from None
            raise

    def _frame(self, head: dict[str, Any]) -> SampleFrame:
        rows = head.get("rows")
        if not isinstance(rows, int) or not 0 < rows <= MOST_ROWS:
            raise self._nonsense()
        names = (TIME, *self.channels)
        columns = {name: np.frombuffer(self._bytes(rows * _ITEM_BYTES)) for name in names}
        self.rows_read += rows
        self.bad_cells, self.ragged_rows = head["bad_cells"], head["ragged_rows"]
        return SampleFrame(columns.pop(TIME), columns)

    def close(self) -> None:
        """End the process; from any thread, and safe twice."""
        self._closed = True
        with self._closing:
            self._process.kill()
            self._process.wait()

    def release(self) -> None:
        """Let go of the pipe, once nobody reads from it any more; safe twice."""
        self.close()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.release()

    def _opened(self) -> tuple[str, ...]:
        channels = self._head().get("channels")
        if not isinstance(channels, list) or not set(channels) <= set(CHANNELS):
            raise self._nonsense()
        return tuple(channels)

    def _head(self) -> dict[str, Any]:
        """The next line. Raises TraceError for an error that it tells."""
        while b"\n" not in self._buffer:
            if len(self._buffer) > _LONGEST_HEAD:
                raise self._nonsense()
            self._more()
        line, _, rest = bytes(self._buffer).partition(b"\n")
        self._buffer = bytearray(rest)
        try:
            head = json.loads(line)
        except ValueError:
            head = None
        if not isinstance(head, dict):
            raise self._nonsense()
        if "error" in head:
            raise TraceError(str(head["error"]))
        return head

    def _bytes(self, count: int) -> bytes:
        while len(self._buffer) < count:
            self._more()
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken

    def _more(self) -> None:
        """Wait for bytes. Raises TraceError if the process ends instead, or does not go on."""
        assert self._process.stdout is not None
        pipe = self._process.stdout.fileno()
        waiting = select.poll()
        waiting.register(pipe, select.POLLIN)
        if not waiting.poll(self._patience_s * 1e3):
            self._process.kill()
            raise TraceError(f"{self.path}: nothing could be read for {self._patience_s:g} s")
        came = os.read(pipe, 1 << 18)
        if not came:
            raise self._ended()
        self._buffer += came

    def _ended(self) -> TraceError:
        why = why_it_ended(self._process.wait(), self._limits) or "it ended without a message"
        return TraceError(f"{self.path}: cannot be read by a process within its limits; {why}")

    def _nonsense(self) -> TraceError:
        self._process.kill()
        return TraceError(f"{self.path}: the process that reads it sends no frames")


def _request(
    path: Path, columns: Mapping[str, ColumnLike], axis: ControllerAxis, skip_rows: int
) -> str:
    named = {
        name: (each.column, each.scale, each.offset, each.minus, each.direction)
        for name, each in columns.items()
    }
    return json.dumps([str(path), named, asdict(axis), skip_rows])


def _started(request: str, limits: ProcessLimits) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "edge_service.recordings.reading_process", request]
    return subprocess.Popen(
        limited_command(command, limits, dies_with_caller=False),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        start_new_session=True,
    )


def main(request: str, out: BinaryIO) -> None:
    """Read a trace and send its frames: a line of JSON each, then its columns as doubles."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the end of the service is no fault of the file
    name, columns, axis, skip_rows = json.loads(request)
    mapped = {channel: ColumnMap(*column) for channel, column in columns.items()}
    try:
        _send_all(Path(name), mapped, ControllerAxis(**axis), skip_rows, out)
    except TraceError as error:
        _line(out, {"error": str(error)})
    except MemoryError:
        _line(out, {"error": f"{name}: its content needs too much memory"})


def _send_all(
    path: Path, columns: Mapping[str, ColumnMap], axis: ControllerAxis, skip: int, out: BinaryIO
) -> None:
    with open_trace(path, columns, axis) as reader:
        _line(out, {"channels": reader.channels})
        for frame in reader:
            counts = {"bad_cells": reader.bad_cells, "ragged_rows": reader.ragged_rows}
            for start in range(max(skip, 0), len(frame), ROWS_AT_ONCE):
                kept = _rows(frame, start, start + ROWS_AT_ONCE)
                _line(out, {"rows": len(kept), **counts})
                for values in (kept.time_s, *(kept.channels[name] for name in reader.channels)):
                    out.write(np.ascontiguousarray(values).tobytes())
            skip -= len(frame)
        _line(out, {"end": True})


def _line(out: BinaryIO, values: Mapping[str, Any]) -> None:
    out.write(json.dumps(values).encode() + b"\n")
    out.flush()


def _rows(frame: SampleFrame, start: int, end: int) -> SampleFrame:
    channels = {name: values[start:end] for name, values in frame.channels.items()}
    return SampleFrame(frame.time_s[start:end], channels)


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.stdout.buffer)
    except BrokenPipeError:
        os._exit(0)  # nobody reads any more
