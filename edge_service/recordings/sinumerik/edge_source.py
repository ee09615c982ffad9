"""Recordings of Industrial Edge in any form: `CYCLE` as time, tool and block as columns."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...messages.channels import TIME
from ...messages.samples import Floats
from ..block import Block, Source
from ..columns import ColumnLike, TraceError
from .block_events import BlockEvents
from .controller_signals import EDGE_CYCLE, edge_signals
from .cycle_clock import PERIOD_S, CycleClock
from .edge_context import EdgeContext, context_beside

_BESIDE = {
    "the NC blocks": {"HFProbeCounter", "GCode"},
    "the list of signals": {"SignalName", "Address"},
}


class EdgeSource:
    """The same rows with `time_s`, and with tool and block where events are known."""

    def __init__(
        self, inner: Source, context: EdgeContext, period_s: float | None, *, sets_time: bool
    ) -> None:
        self.context = context
        self.sets_time = sets_time
        self._inner = inner
        self.clock = CycleClock(period_s or context.period_s or PERIOD_S)
        self._told = period_s is not None or context.period_s is not None
        self._counted = EDGE_CYCLE in inner.names
        self._wanted: set[str] = set()
        own = (TIME,) if sets_time and TIME not in inner.names else ()
        events = BlockEvents.names if self._counted and context.has_events else ()
        self.names = (*own, *inner.names, *events)

    @property
    def ragged_rows(self) -> int:
        """Rows with too few or too many cells so far."""
        return self._inner.ragged_rows

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return self._inner.fraction_read

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the time, one line each; complete at the end."""
        return (*self._inner.remarks, *self._time_remarks(), *self.context.remarks)

    def _time_remarks(self) -> list[str]:
        if not self.sets_time or TIME not in self._wanted:
            return []
        guessed = (
            "" if self._told else "; the usual period of Industrial Edge, as no header says it"
        )
        if not self._counted:
            period_s = self.clock.period_s
            return [f"no CYCLE and no time: rows are taken as {period_s:g} s apart{guessed}"]
        first, *more = self.clock.remarks()
        return [first + guessed, *more]

    def holds_numbers(self, name: str) -> bool:
        """Tell whether a column may hold numbers."""
        return name not in self._inner.names or self._inner.holds_numbers(name)

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = set(names)
        inner = [name for name in names if name in self._inner.names]
        if self._counted and self._derived() and EDGE_CYCLE not in inner:
            inner.append(EDGE_CYCLE)
        self._inner.want(inner)

    def _derived(self) -> set[str]:
        """Wanted columns that are not the file's own."""
        time = {TIME} if self.sets_time else set()
        return self._wanted & (time | set(BlockEvents.names))

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        block = self._inner.read_block()
        if block is None or not self._derived():
            return block
        if not self._counted:
            values = {TIME: block.row_number * self.clock.period_s}
        else:
            values = self._from_count(block.values[EDGE_CYCLE])
        kept = {name: values[name] for name in self._derived()}
        return Block(block.values | kept, block.row_number, block.text)

    def _from_count(self, cycle: Floats) -> dict[str, Floats]:
        time_s, run = self.clock.times(np.asarray(cycle, dtype=np.float64))
        if not set(BlockEvents.names) & self._wanted:
            return {TIME: time_s}
        return {TIME: time_s} | self.context.events.at(cycle, run)

    def close(self) -> None:
        """Close the file; safe twice."""
        self._inner.close()


def edge_recording(path: Path, source: Source, columns: Mapping[str, ColumnLike]) -> Source:
    """The source with what Industrial Edge means by its columns; any other as it is.

    The time is the file's or the machine file's where they have one, and that of the count if not.

    Args:
        path: the file.
        source: the open file.
        columns: of the machine file; a scale of `CYCLE` is the period.

    Raises:
        TraceError: it is one of the files beside a recording.
    """
    if isinstance(source, EdgeSource):
        return source
    _refuse_beside(path, set(source.names))
    if not edge_signals(source.names):
        return source
    mapped = columns.get(TIME)
    by_count = mapped is not None and mapped.column == EDGE_CYCLE
    period_s = mapped.scale if mapped is not None and by_count else None
    sets_time = by_count or (mapped is None and TIME not in source.names)
    context: EdgeContext | None = getattr(source, "context", None)
    return EdgeSource(source, context or context_beside(path), period_s, sets_time=sets_time)


def _refuse_beside(path: Path, names: set[str]) -> None:
    for what, columns in _BESIDE.items():
        if columns <= names:
            raise TraceError(
                f"{path}: holds {what} of a recording of Industrial Edge; expected its "
                "..._hfdata.csv, which is read together with it"
            )
