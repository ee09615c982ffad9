"""Recordings of Industrial Edge in any form: rows, `CYCLE` as time, tool and block as columns.

`SignalListHFData` of a `Header` lists a row's signals (`Name`, `Type`, `Axis`, `Address`),
`CycleTimeMs` is the length of a cycle, `CYCLE` the count of the position controller's cycles.
Layout: CaptureDataParser of max-scw, and its example.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...messages.channels import TIME
from ...messages.samples import Booleans, Floats
from ..columns import ColumnLike, TraceError
from ..source import Block, Source, Text
from .edge_context import BlockEvents, EdgeContext, context_beside
from .signals import EDGE_CYCLE, edge_signals

PERIOD_S = 0.002
"""Of Industrial Edge's high-frequency data: 500 Hz."""
RESTART_GAP_S = 1.0
"""Time between two runs where the count begins anew."""
WIDE = 1.5
"""A step of so many usual ones is a gap."""
HEADER, PAYLOAD, SAMPLES, EVENT = "Header", "Payload", "HFData", "HFBlockEvent"
MOST_SIGNALS = 4096
SHORTEST_S, LONGEST_S = 1e-5, 10.0
_BESIDE = {
    "the NC blocks": {"HFProbeCounter", "GCode"},
    "the list of signals": {"SignalName", "Address"},
}


class CycleClock:
    """Time of each sample, from 0 at the first one; gaps and restarts are counted.

    A count that falls is the recorder begun anew: a new run, a second after the one before. A count
    that stays is the same sample again, and is handed on as it is.

    Attributes:
        period_s: of the count.
        restarts, gaps: how often the count has begun anew, and has left out samples.
        lost: samples that it has left out.
    """

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.restarts = 0
        self._restart_rows: list[int] = []
        self._rows = 0
        self.gaps = 0
        self.lost = 0.0
        self._usual: float | None = None
        self._last: float | None = None
        self._origin = 0.0
        self._offset = 0.0  # of the run, in counts: the same sums however a recording is parted

    @property
    def step_s(self) -> float | None:
        """Usual time from one sample to the next; None before two have come."""
        return None if self._usual is None else self._usual * self.period_s

    def times(self, cycle: Floats) -> tuple[Floats, Floats]:
        """Times in s and number of the run of each sample, (n,); NaN where there is no count."""
        counted = np.isfinite(cycle)
        time_s, run = np.full(cycle.shape, np.nan), np.full(cycle.shape, float(self.restarts))
        counts = cycle[counted]
        if len(counts):
            if self._last is None:
                self._origin = self._last = float(counts[0])
            time_s[counted], run[counted] = self._counted(counts, np.flatnonzero(counted))
        self._rows += len(cycle)
        return time_s, run

    def _counted(self, counts: Floats, rows: np.ndarray) -> tuple[Floats, Floats]:
        assert self._last is not None
        before = np.concatenate(([self._last], counts[:-1]))
        steps = counts - before
        self._count_gaps(steps)
        time_s, run = np.empty(len(counts)), np.empty(len(counts))
        ends = sorted({0, *np.flatnonzero(steps < 0.0).tolist(), len(counts)})
        for start, stop in itertools.pairwise(ends):
            if steps[start] < 0.0:
                self._restart(float(before[start]), float(counts[start]), int(rows[start]))
            part = slice(start, stop)
            time_s[part] = (self._offset + (counts[part] - self._origin)) * self.period_s
            run[part] = self.restarts
        self._last = float(counts[-1])
        return time_s, run

    def _restart(self, before: float, first: float, row: int) -> None:
        self._offset += (before - self._origin) + RESTART_GAP_S / self.period_s
        self._origin = first
        self.restarts += 1
        self._restart_rows.append(self._rows + row)

    def _count_gaps(self, steps: Floats) -> None:
        forward = steps[steps > 0.0]
        if self._usual is None and len(forward):
            self._usual = float(np.median(forward))
        if self._usual is not None:
            wide = steps[steps > WIDE * self._usual]
            self.gaps += len(wide)
            self.lost += float(np.sum(wide / self._usual - 1.0))

    def remarks(self) -> list[str]:
        """One line each on the period, on gaps and on restarts."""
        step = self._usual or 1.0
        every = "" if step == 1.0 else f", every {step:g}. one recorded"
        lines = [f"time_s = {self.period_s:g} s * CYCLE{every}"]
        if self.gaps:
            lines.append(f"CYCLE: {self.gaps} gaps, {self.lost:.0f} samples missing")
        if self.restarts:
            shown = ", ".join(str(row) for row in self._restart_rows[:5])
            more = ", ..." if self.restarts > 5 else ""
            lines.append(
                f"CYCLE starts over {self.restarts} times (at row {shown}{more}): each is a new "
                f"run, {RESTART_GAP_S:g} s after the one before"
            )
        return lines


class EdgeRows:
    """The signals of one `Header`. A row without a number for each is set aside and counted.

    Args:
        header: as JSON gives it.
        first: the first rows; they show whether the count stands before the listed signals.
        context: gets the period and the names of the axes.

    Raises:
        ValueError: one line; a header without signals.
    """

    def __init__(self, header: Any, first: Sequence[Any], context: EdgeContext) -> None:
        listed = header.get("SignalListHFData") if isinstance(header, dict) else None
        signals = [each for each in listed or () if isinstance(each, dict)]
        if not signals or len(signals) > MOST_SIGNALS:
            raise ValueError("no SignalListHFData with signals in its Header")
        names = [str(each.get("Address") or each.get("Name") or "") for each in signals]
        for name, each in zip(names, signals, strict=True):
            context.name_axis(name, str(each.get("Axis") or ""))
        context.period_s = _period_s(header.get("CycleTimeMs"))
        width = len(first[0]) if first and isinstance(first[0], list) else 0
        if width == len(names) + 1 and EDGE_CYCLE not in names:
            names.insert(0, EDGE_CYCLE)  # each row begins with its count, listed or not
        self.names = tuple(names)
        self.ragged_rows = 0
        self._text: dict[str, Text] = {}

    def numbers(self, rows: Sequence[Any]) -> tuple[Floats, Booleans]:
        """Numbers of the rows that are whole, (m, signals), and which those are, (n,)."""
        width = len(self.names)
        whole = np.array([isinstance(row, list) and len(row) == width for row in rows], dtype=bool)
        self.ragged_rows += int(np.count_nonzero(~whole))
        kept = [row for row, each in zip(rows, whole, strict=True) if each]
        try:
            samples = np.array(kept, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            samples = np.empty(0)
        if samples.shape != (len(kept), width):
            cells = [
                [self._cell(*each) for each in zip(self.names, row, strict=True)] for row in kept
            ]
            samples = np.array(cells, dtype=np.float64).reshape(-1, width)
        return samples, whole

    def take_text(self) -> dict[str, Text]:
        """Texts that stood in place of numbers since the last call, by signal."""
        text, self._text = self._text, {}
        return text

    def _cell(self, name: str, value: Any) -> float:
        if value is None:
            return math.nan
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            before = self._text.get(name, Text(0, str(value)[:40]))
            self._text[name] = Text(before.count + 1, before.first)
            return math.nan


def _period_s(cycle_time_ms: Any) -> float | None:
    try:
        period_s = float(cycle_time_ms) / 1e3
    except (TypeError, ValueError, OverflowError):
        return None
    return period_s if SHORTEST_S <= period_s <= LONGEST_S else None


class EdgeSource(Source):
    """The same rows with `time_s`, and with tool and block where events are known."""

    def __init__(
        self, inner: Source, context: EdgeContext, period_s: float | None, *, sets_time: bool
    ) -> None:
        self.path, self.ragged_rows, self.wanted = inner.path, 0, []
        self.context = context
        self.sets_time = sets_time
        self._inner = inner
        self.clock = CycleClock(period_s or context.period_s or PERIOD_S)
        self._told = period_s is not None or context.period_s is not None
        self._counted = EDGE_CYCLE in inner.names
        own = (TIME,) if sets_time and TIME not in inner.names else ()
        events = BlockEvents.names if self._counted and context.has_events else ()
        self.names = (*own, *inner.names, *events)

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return self._inner.fraction_read

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the time, one line each; complete at the end."""
        return (*self._inner.remarks, *self._time_remarks(), *self.context.remarks)

    def _time_remarks(self) -> list[str]:
        if not self.sets_time or TIME not in self.wanted:
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
        """Return whether a column may hold numbers."""
        return name not in self._inner.names or self._inner.holds_numbers(name)

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self.wanted = names
        inner = [name for name in names if name in self._inner.names]
        if self._counted and self._derived() and EDGE_CYCLE not in inner:
            inner.append(EDGE_CYCLE)
        self._inner.want(inner)

    def _derived(self) -> set[str]:
        """Wanted columns that are not the file's own."""
        time = {TIME} if self.sets_time else set()
        return set(self.wanted) & (time | set(BlockEvents.names))

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        block = self._inner.read_block()
        self.ragged_rows = self._inner.ragged_rows
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
        if not set(BlockEvents.names) & set(self.wanted):
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
    for what, columns_of_it in _BESIDE.items():
        if columns_of_it <= set(source.names):
            raise TraceError(
                f"{path}: holds {what} of a recording of Industrial Edge; expected its "
                "..._hfdata.csv, which is read together with it"
            )
    if not edge_signals(source.names):
        return source
    mapped = columns.get(TIME)
    by_count = mapped is not None and mapped.column == EDGE_CYCLE
    period_s = mapped.scale if mapped is not None and by_count else None
    sets_time = by_count or (mapped is None and TIME not in source.names)
    context: EdgeContext | None = getattr(source, "context", None)
    return EdgeSource(source, context or context_beside(path), period_s, sets_time=sets_time)
