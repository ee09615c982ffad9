"""A recording of any form in, a trace of another form out: CSV, Parquet or MCAP."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np

from ..atomic import replaced_bytes
from ..checks.positions import speed_doubts
from ..command_answer import Answer
from ..health.store.history import History, HistoryForm, write_history
from ..health.store.store import Store, StoreFailedError
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..recordings.columns import TraceError
from ..recordings.sinumerik.signals import ControllerAxis
from ..recordings.writer import CSV_SUFFIX, TraceWriter
from .recordings import Progress, open_recording, reported, silent, spread

_GAP_STEPS = 1.5


def convert(
    source: Path,
    out: Path,
    machine: Machine,
    axis: ControllerAxis | None = None,
    *,
    keep_all: bool = False,
    progress: Progress = silent,
) -> Answer:
    """Read a recording as the machine file says and write it in the form of the name `out`.

    Raises TraceError: one line with the file, what was wrong and what was expected.
    """
    if keep_all and out.suffix.lower() == CSV_SUFFIX:
        raise TraceError(f"{out}: CSV holds channels only; all columns go into .parquet or .mcap")
    if out.exists() and source.exists() and out.samefile(source):
        raise TraceError(f"{out}: is the recording itself; expected another name")
    rows = _Rows()
    with (
        open_recording(machine, source, axis, keep_all=keep_all) as reader,
        TraceWriter(out, reader.channels) as writer,
    ):

        def written() -> Iterator[SampleFrame]:
            for frame in reported(reader, f"converting {source.name}", progress):
                writer.write(frame)
                rows.add(frame)
                yield frame

        doubts = speed_doubts(spread(written()))
    rate_hz = None if rows.step_s is None else 1.0 / rows.step_s
    duration_s = (rows.last_s or 0.0) - rows.first_s
    missing = {name: count for name, count in reader.bad_cells.items() if count}
    remarks = (*reader.remarks, *doubts)
    rate = "" if rate_hz is None else f" at {rate_hz:.6g} Hz"
    head = f"{out}: {rows.count} rows, {duration_s:.6g} s{rate}, {rows.gaps} gaps"
    lines = [f"{head}; {', '.join(reader.channels)}", *remarks]
    lines += [f"{name}: {count} values missing" for name, count in missing.items()]
    if reader.ragged_rows:
        lines.append(f"{reader.ragged_rows} rows could not be read and are left out")
    if reader.ignored:
        lines.append(f"not written: {', '.join(reader.ignored)}")
    document = {
        "out": str(out),
        "rows": rows.count,
        "channels": reader.channels,
        "rate_hz": rate_hz,
        "duration_s": duration_s,
        "gaps": rows.gaps,
        "missing": missing,
        "set_aside": reader.ragged_rows,
        "ignored": reader.ignored,
        "remarks": remarks,
    }
    return Answer("\n".join(lines), document)


def is_database(source: Path) -> bool:
    """Return whether SQLite has written a file."""
    try:
        with source.open("rb") as file:
            return file.read(16) == b"SQLite format 3\0"
    except OSError:
        return False


def convert_history(source: Path, out: Path, progress: Progress = silent) -> Answer:
    """Write the history of all axes, also of a running service. Raises TraceError, one line."""
    try:
        form = HistoryForm(out.suffix.removeprefix("."))
    except ValueError:
        raise TraceError(f"{out}: history goes into .csv or .parquet") from None
    progress(f"converting {source.name}")
    try:
        with closing(Store(source, mends=False)) as store, replaced_bytes(out) as file:
            history = History(store)
            axes = history.axes()
            rows = write_history(file, form, history, axes)
    except StoreFailedError as error:
        raise TraceError(str(error)) from None
    except OSError as error:
        raise TraceError(f"{out}: {error.strerror}") from None
    text = f"{out}: {rows} rows of {len(axes)} axes: {', '.join(axes) or 'none'}"
    return Answer(text, {"out": str(out), "rows": rows, "axes": axes})


class _Rows:
    """Counts rows and gaps; the usual step is that of the first run of rows."""

    def __init__(self) -> None:
        self.count = 0
        self.gaps = 0
        self.step_s: float | None = None
        self.first_s = 0.0
        self.last_s: float | None = None

    def add(self, frame: SampleFrame) -> None:
        time_s = frame.time_s
        if self.last_s is None:
            self.first_s = float(time_s[0])
        else:
            time_s = np.concatenate([[self.last_s], time_s])
        steps_s = np.diff(time_s)
        forward_s = steps_s[steps_s > 0.0]
        if self.step_s is None and forward_s.size:
            self.step_s = float(np.median(forward_s))
        if self.step_s is not None:
            self.gaps += int(np.count_nonzero(steps_s > _GAP_STEPS * self.step_s))
        self.count += len(frame)
        self.last_s = float(time_s[-1])
