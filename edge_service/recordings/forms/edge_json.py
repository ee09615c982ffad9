"""The JSON of Industrial Edge's "Capture4Analysis" (Analyze MyWorkpiece).

`Header` names the signals; `Payload` is a list of messages: `HFData`, a block of samples with one
number per signal, and `HFBlockEvent`, the NC block that is begun. Others (`HFTimestamp`,
`HFCallEvent`, `LFData`) say nothing of the axes.
"""

from pathlib import Path
from typing import Any

from ..block import Block, number_rows
from ..columns import TraceError
from ..sinumerik.edge_context import EdgeContext
from ..sinumerik.edge_rows import EVENT, HEADER, PAYLOAD, SAMPLES, EdgeRows
from .form import Form
from .json_messages import JsonError, JsonMessages

BLOCK_ROWS = 1 << 12


class EdgeJsonSource:
    """An open recording. A row without a number for each signal is set aside and counted."""

    remarks: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        self.context = EdgeContext(has_events=True)
        self._rows_seen = 0
        self._wanted: list[str] = []
        self._waiting: list[Any] = []
        self._ended = False
        self._bytes = path.stat().st_size
        self._file = path.open("rb")
        try:
            self._messages = JsonMessages(self._file, PAYLOAD)
            self._rows = self._named(self._messages.members.get(HEADER))
        except JsonError as error:
            self._file.close()
            raise self._wrong(error) from None
        except BaseException:
            self._file.close()
            raise
        self.names = self._rows.names

    @property
    def ragged_rows(self) -> int:
        """Rows with too few or too many cells so far."""
        return self._rows.ragged_rows

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
        samples, kept = self._rows.numbers(rows)
        number = number_rows(self._rows_seen, len(rows))[kept]
        self._rows_seen += len(rows)
        index = {name: column for column, name in enumerate(self.names)}
        values = {name: samples[:, index[name]] for name in self._wanted}
        text = self._rows.take_text()
        return Block(values, number, {name: text[name] for name in self._wanted if name in text})

    def _named(self, header: Any) -> EdgeRows:
        """The signals of a row. Raises TraceError."""
        self._fill(1)
        try:
            return EdgeRows(header, self._waiting, self.context)
        except ValueError as error:
            raise TraceError(f"{self.path}: {error}") from None

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
            samples, event = message.get(SAMPLES), message.get(EVENT)
            if isinstance(samples, list):
                self._waiting += samples
            if isinstance(event, dict):
                self.context.events.add(event)

    def _wrong(self, error: JsonError) -> TraceError:
        return TraceError(f"{self.path}: {error}; {self._rows_seen} samples were read")


def _recognises(head: bytes, _path: Path) -> bool:
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    return start.startswith(b"{") and (b'"SignalListHFData"' in head or b'"HFData"' in head)


FORM = Form("JSON of Industrial Edge", _recognises, lambda path, _axis: EdgeJsonSource(path))
