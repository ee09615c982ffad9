"""Writing a trace: the file appears whole or not at all."""

import contextlib
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..atomic import replaced_bytes
from ..messages.samples import CHANNELS, TIME, SampleFrame
from .columns import TraceError
from .parquet import PARQUET_SUFFIXES
from .reader import handed

_ROWS_AT_ONCE = 1 << 16
CSV_SUFFIX, MCAP_SUFFIX = ".csv", ".mcap"
TOPIC = "axis/samples"
SCHEMA_NAME = "edge_service.Sample"


class TraceWriter(contextlib.AbstractContextManager["TraceWriter"]):
    """Writes frames to a file that takes the place of `path` at the end, if there is no exception.

    Numbers are written with all their digits, what is not finite as missing. A channel that a frame
    lacks is missing in its rows.

    Args:
        path: the file to write, .csv, .parquet or .mcap; one that exists is replaced.
        channels: the channels to write beside `time_s`, in this order.

    Raises TraceError: unknown suffix, a folder that cannot be written to, or a missing package.
    """

    def __init__(self, path: Path, channels: Sequence[str]) -> None:
        self.path, self.channels = path, tuple(channels)
        self._pending: list[SampleFrame] = []
        self._place = contextlib.ExitStack()
        suffix = path.suffix.lower()
        if suffix not in (CSV_SUFFIX, *PARQUET_SUFFIXES, MCAP_SUFFIX):
            raise TraceError(f"{path}: it ends in {suffix!r}; expected .csv, .parquet or .mcap")
        if path.is_dir():
            raise TraceError(f"{path}: a folder; expected the name of a file")
        with self._one_line_errors():
            file = self._place.enter_context(replaced_bytes(path))
            self._sink = _open_sink(suffix, file, (TIME, *self.channels))
            self._place.callback(self._sink.close)

    def write(self, frame: SampleFrame) -> None:
        """Add the rows of a frame.

        Raises TraceError: the frame holds a channel that the header lacks, or the disk is full.
        """
        if late := [name for name in frame.channels if name not in self.channels]:
            raise TraceError(f"{self.path}: channel {late[0]!r} came after the header was written")
        self._pending.append(frame)
        if sum(map(len, self._pending)) >= _ROWS_AT_ONCE:
            with self._one_line_errors():
                self._flush()

    def __exit__(self, *error: Any) -> None:
        with self._one_line_errors():
            if error[0] is None:
                self._flush()
            self._place.__exit__(*error)

    def _flush(self) -> None:
        import pyarrow as pa

        if not self._pending:
            return
        held = [(np.full(len(e), np.nan), {TIME: e.time_s, **e.channels}) for e in self._pending]
        self._pending, arrays = [], {}
        for name in (TIME, *self.channels):
            values = np.concatenate([each.get(name, none) for none, each in held])
            arrays[name] = pa.array(values, type=pa.float64(), mask=~np.isfinite(values))
        self._sink.write_table(pa.table(arrays))

    @contextlib.contextmanager
    def _one_line_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, TraceError) as error:
            with contextlib.suppress(OSError):
                self._place.__exit__(type(error), error, None)
            if isinstance(error, TraceError):
                raise TraceError(f"{self.path}: {error}") from None
            reason = error.strerror or error
            raise TraceError(f"{self.path}: cannot be written ({reason})") from None


def _open_sink(suffix: str, file: BinaryIO, names: Sequence[str]) -> Any:
    """A writer of Arrow tables; the header of a CSV file is written unquoted."""
    if suffix == MCAP_SUFFIX:
        return McapSink(file, names)
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    schema = pa.schema([(name, pa.float64()) for name in names])
    if suffix in PARQUET_SUFFIXES:
        return pyarrow.parquet.ParquetWriter(file, schema, write_page_checksum=True)
    file.write((",".join(names) + "\n").encode())
    options = pyarrow.csv.WriteOptions(include_header=False)
    return pyarrow.csv.CSVWriter(file, schema, write_options=options)


class McapSink:
    """Writes Arrow tables to an open file. A missing value is null.

    MCAP counts log times in ns from 0: `time_s` is the log time, or its distance from the first
    row where that is negative (metadata record `trace`, key `log_time_zero_s`).
    """

    def __init__(self, file: BinaryIO, names: Sequence[str]) -> None:
        try:
            from mcap.writer import Writer
        except ImportError:
            raise TraceError("MCAP needs a package that is not installed: mcap") from None
        self._writer: Any = Writer(file)
        self._writer.start(library="edge-service")
        shown: dict[str, Any] = {TIME: {"type": "number", "description": "the axis' own clock, s"}}
        for name in names:
            known = CHANNELS.get(name)
            text = f"{known.description}, {known.unit}" if known else "as recorded, in its own unit"
            shown.setdefault(name, {"type": ["number", "null"], "description": text})
        schema = {"type": "object", "properties": shown, "required": [TIME]}
        about = self._writer.register_schema(SCHEMA_NAME, "jsonschema", json.dumps(schema).encode())
        self._channel_id = self._writer.register_channel(TOPIC, "json", about)
        self._zero_s: float | None = None
        self._rows = 0

    def write_table(self, table: Any) -> None:
        """Add the rows of an Arrow table. Raises TraceError for a time that MCAP cannot hold."""
        for number, row in enumerate(table.to_pylist(), start=self._rows):
            time_s = row[TIME]
            if time_s is None:
                raise TraceError(f"row {number + 1} has no time; MCAP orders its messages by time")
            if self._zero_s is None:
                self._zero_s = min(time_s, 0.0)
            log_time_ns = round((time_s - self._zero_s) * 1e9)
            if not 0 <= log_time_ns < 1 << 64:
                unable = "cannot be a log time of MCAP, which counts ns from 0"
                raise TraceError(f"row {number + 1}: {time_s:g} s {unable}")
            content = json.dumps(row).encode()
            self._writer.add_message(self._channel_id, log_time_ns, content, log_time_ns, number)
        self._rows += len(table)

    def close(self) -> None:
        """Write the index; the file stays open."""
        zero_s = self._zero_s or 0.0
        self._writer.add_metadata("trace", {"log_time_zero_s": repr(zero_s)})
        self._writer.finish()


def write_parts(
    frames: Iterator[SampleFrame],
    channels: Sequence[str],
    paths: Sequence[Path],
    block_s: float,
    every: int,
) -> bool:
    """Part a recording: each `every`th block goes to the second path, the others to the first.

    Returns whether there is such a block. Raises TraceError.
    """
    begun_s, rows = np.nan, 0
    with contextlib.ExitStack() as files:
        writers = [files.enter_context(TraceWriter(path, channels)) for path in paths]
        for frame in frames:
            begun_s = np.fmin(begun_s, frame.time_s[0])
            is_chosen = np.floor((frame.time_s - begun_s) / block_s) % every == every - 1
            writers[0].write(frame.part(~is_chosen))
            writers[1].write(frame.part(is_chosen))
            rows += int(is_chosen.sum())
    return rows > 0


if __name__ == "__main__":
    read, written = map(Path, sys.argv[1:])
    rows = handed(read)
    with TraceWriter(written, tuple(rows.channels)) as writer:
        writer.write(rows)
