"""A recording of any form in, a trace of another form out: CSV, Parquet or MCAP."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from ..atomic import replaced_bytes
from ..checks.positions import speed_doubts
from ..command_answer import Answer, progress
from ..health.store.history import History, HistoryForm, write_history
from ..health.store.store import Store, StoreFailedError
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..recordings.columns import TraceError
from ..recordings.reader import spread
from ..recordings.sinumerik.signals import ControllerAxis
from ..recordings.writer import CSV_SUFFIX, TraceWriter
from .recordings import open_recording, reported


def convert(
    source: Path,
    out: Path,
    machine: Machine,
    axis: ControllerAxis | None = None,
    *,
    keep_all: bool = False,
) -> Answer:
    """Read a recording as the machine file says and write it in the form of the name `out`.

    Raises TraceError: one line with the file, what was wrong and what was expected.
    """
    if keep_all and out.suffix.lower() == CSV_SUFFIX:
        raise TraceError(f"{out}: CSV holds channels only; all columns go into .parquet or .mcap")
    if out.exists() and source.exists() and out.samefile(source):
        raise TraceError(f"{out}: is the recording itself; expected another name")
    rows = 0
    with (
        open_recording(machine, source, axis, keep_all=keep_all) as reader,
        TraceWriter(out, reader.channels) as writer,
    ):

        def written() -> Iterator[SampleFrame]:
            nonlocal rows
            for frame in reported(reader, f"converting {source.name}"):
                writer.write(frame)
                rows += len(frame)
                yield frame

        doubts = speed_doubts(spread(written()))
    missing = {name: count for name, count in reader.bad_cells.items() if count}
    remarks = (*reader.remarks, *doubts)
    lines = [f"{out}: {rows} rows; {', '.join(reader.channels)}", *remarks]
    lines += [f"{name}: {count} values missing" for name, count in missing.items()]
    if reader.ragged_rows:
        lines.append(f"{reader.ragged_rows} rows could not be read and are left out")
    if reader.ignored:
        lines.append(f"not written: {', '.join(reader.ignored)}")
    document = {"out": str(out), "rows": rows, "channels": reader.channels, "missing": missing}
    rest = {"set_aside": reader.ragged_rows, "ignored": reader.ignored, "remarks": remarks}
    return Answer("\n".join(lines), document | rest)


def convert_history(source: Path, out: Path) -> Answer:
    """Write the history of all axes, also of a running service. Raises TraceError, one line."""
    forms: dict[str, HistoryForm] = {CSV_SUFFIX: "csv", ".parquet": "parquet"}
    form = forms.get(out.suffix)
    if form is None:
        raise TraceError(f"{out}: history goes into .csv or .parquet")
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
