"""The JSON of Industrial Edge's "Capture4Analysis" (Analyze MyWorkpiece).

`Header` names the signals (`SignalListHFData`: `Name`, `Type`, `Axis`, `Address`) and the length of
a cycle (`CycleTimeMs`); `Payload` is a list of messages: `HFData`, a block of samples with one
number per signal, and `HFBlockEvent`, the NC block that is begun. Others (`HFTimestamp`,
`HFCallEvent`, `LFData`) say nothing of the axes. Layout: CaptureDataParser of max-scw, and its
example.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from ...messages.samples import Floats
from ..block import Block, Text, number_rows
from ..columns import TraceError
from ..sinumerik.controller_signals import EDGE_CYCLE
from ..sinumerik.edge_context import EdgeContext
from .form import Form
from .json_messages import JsonError, JsonMessages

BLOCK_ROWS = 1 << 12
MOST_SIGNALS = 4096
SHORTEST_S, LONGEST_S = 1e-5, 10.0
_HEADER, _PAYLOAD, _SAMPLES, _EVENT = "Header", "Payload", "HFData", "HFBlockEvent"


class EdgeJsonSource:
    """An open recording. A row without a number for each signal is set aside and counted."""

    remarks: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ragged_rows = 0
        self.context = EdgeContext(has_events=True)
        self._rows_seen = 0
        self._wanted: list[str] = []
        self._waiting: list[Any] = []
        self._text: dict[str, Text] = {}
        self._ended = False
        self._bytes = path.stat().st_size
        self._file = path.open("rb")
        try:
            self._messages = JsonMessages(self._file, _PAYLOAD)
            self.names = self._named(self._messages.members.get(_HEADER))
        except JsonError as error:
            self._file.close()
            raise self._wrong(error) from None
        except BaseException:
            self._file.close()
            raise

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return 1.0 if self._file.closed else self._file.tell() / max(self._bytes, 1)

    def holds_numbers(self, name: str) -> bool:
        """Any signal may."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = names

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        self._fill(BLOCK_ROWS)
        if not self._waiting:
            return None
        rows, self._waiting = self._waiting, []
        samples, kept = self._samples(rows)
        number = number_rows(self._rows_seen, len(rows))[kept]
        self._rows_seen += len(rows)
        index = {name: column for column, name in enumerate(self.names)}
        values = {name: samples[:, index[name]] for name in self._wanted}
        text, self._text = self._text, {}
        return Block(values, number, {name: text[name] for name in self._wanted if name in text})

    def _named(self, header: Any) -> tuple[str, ...]:
        """Names of the signals in the order of a row. Raises TraceError."""
        listed = header.get("SignalListHFData") if isinstance(header, dict) else None
        signals = [each for each in listed or () if isinstance(each, dict)]
        if not signals or len(signals) > MOST_SIGNALS:
            raise TraceError(f"{self.path}: no SignalListHFData with signals in its Header")
        names = [str(each.get("Address") or each.get("Name") or "") for each in signals]
        for name, each in zip(names, signals, strict=True):
            self.context.name_axis(name, str(each.get("Axis") or ""))
        self.context.period_s = _period_s(header.get("CycleTimeMs"))
        self._fill(1)
        width = len(self._waiting[0]) if self._waiting and _is_row(self._waiting[0]) else 0
        if width == len(names) + 1 and EDGE_CYCLE not in names:
            names.insert(0, EDGE_CYCLE)  # each row begins with its count, listed or not
        return tuple(names)

    def _fill(self, rows: int) -> None:
        """Read messages until so many rows wait, or all have been read."""
        while len(self._waiting) < rows and not self._ended:
            try:
                message = self._messages.next()
            except StopIteration:
                self._ended = True
                return
            except JsonError as error:
                raise self._wrong(error) from None
            if not isinstance(message, dict):
                continue
            samples, event = message.get(_SAMPLES), message.get(_EVENT)
            if isinstance(samples, list):
                self._waiting += samples
            if isinstance(event, dict):
                self.context.events.add(event)

    def _samples(self, rows: list[Any]) -> tuple[Floats, np.ndarray]:
        """Numbers of the rows that are whole, (m, signals), and which those are, (n,)."""
        width = len(self.names)
        whole = np.array([_is_row(row) and len(row) == width for row in rows], dtype=bool)
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

    def _cell(self, name: str, value: Any) -> float:
        if value is None:
            return math.nan
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            before = self._text.get(name, Text(0, str(value)[:40]))
            self._text[name] = Text(before.count + 1, before.first)
            return math.nan

    def _wrong(self, error: JsonError) -> TraceError:
        return TraceError(f"{self.path}: {error}; {self._rows_seen} samples were read")


def _is_row(row: Any) -> bool:
    return isinstance(row, list)


def _period_s(cycle_time_ms: Any) -> float | None:
    try:
        period_s = float(cycle_time_ms) / 1e3
    except (TypeError, ValueError, OverflowError):
        return None
    return period_s if SHORTEST_S <= period_s <= LONGEST_S else None


def _recognises(head: bytes, _path: Path) -> bool:
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    return start.startswith(b"{") and (b'"SignalListHFData"' in head or b'"HFData"' in head)


FORM = Form("JSON of Industrial Edge", _recognises, lambda path, _axis: EdgeJsonSource(path))
