"""The JSON of Industrial Edge's "Capture4Analysis" (Analyze MyWorkpiece), message by message.

`Header` names the signals; `Payload` is a list of messages: `HFData`, a block of samples with one
number per signal, and `HFBlockEvent`, the NC block that is begun. Others (`HFTimestamp`,
`HFCallEvent`, `LFData`) say nothing of the axes.
"""

import codecs
import json
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from ..columns import TraceError
from ..source import BYTE_ORDER_MARK, Block, Source
from .edge import EVENT, HEADER, PAYLOAD, SAMPLES, EdgeContext, EdgeRows

BLOCK_ROWS = 1 << 12
CHUNK_BYTES = 1 << 18
LONGEST_ELEMENT, MOST_MEMBERS = 1 << 23, 100
_BETWEEN = " \t\r\n,:"
_JSON = json.JSONDecoder()


class JsonText:
    """Values of a JSON text one by one, in bounded memory."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = codecs.getreader("utf-8-sig")(file, "replace")
        self._text, self._position, self._passed = "", 0, 0

    def elements(self, name: str, members: dict[str, Any]) -> Iterator[Any]:
        """Elements of the list `name` of the outermost object; `members` takes those before it.

        Raises ValueError, one line, for JSON that is cut off or damaged, or another than expected.
        """
        self._position += self._peek() == "{"
        while self._peek() != "}" and len(members) <= MOST_MEMBERS:
            key = self._value()
            if key == name and self._peek() == "[":
                break
            members[str(key)] = self._value()
        else:
            raise ValueError(f"no list {name!r}")
        self._position += 1
        while self._peek() != "]":
            yield self._value()

    def _peek(self) -> str:
        """The next character that is not between two values; empty at the end."""
        while self._position < len(self._text) or self._more():
            if self._text[self._position] not in _BETWEEN:
                return self._text[self._position]
            self._position += 1
        return ""

    def _value(self) -> Any:
        self._peek()
        while True:
            try:
                value, end = _JSON.raw_decode(self._text, self._position)
            except RecursionError:
                raise ValueError("its values are nested too deeply") from None
            except ValueError as error:
                if not self._more():
                    place = f"behind character {self._passed + self._position}"
                    reason = f"cut off or damaged {place} ({str(error)[:60]})"
                    raise ValueError(reason) from None
            else:
                if end < len(self._text) or not self._more():  # a number may go on
                    self._position = end
                    return value

    def _more(self) -> bool:
        """Read on; False at the end of the file."""
        rest = self._text[self._position :]
        if len(rest) > LONGEST_ELEMENT:
            raise ValueError(f"an element of more than {LONGEST_ELEMENT} characters")
        text = self._file.read(max(len(rest), CHUNK_BYTES))
        if text:
            self._passed += self._position
            self._text, self._position = rest + text, 0
        return bool(text)


class EdgeJsonSource(Source):
    """An open recording. A row without a number for each signal is set aside and counted."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path, file)
        self.context = EdgeContext(has_events=True)
        self._waiting: list[Any] = []
        members: dict[str, Any] = {}
        self._messages = JsonText(file).elements(PAYLOAD, members)
        self._fill(1)
        try:
            self._rows = EdgeRows(members.get(HEADER), self._waiting, self.context)
        except ValueError as error:
            raise TraceError(f"{path}: {error}") from None
        self.names = self._rows.names

    def read_block(self) -> Block | None:
        self._fill(BLOCK_ROWS)
        if not self._waiting:
            return None
        rows, self._waiting = self._waiting, []
        samples, kept = self._rows.numbers(rows)
        self.ragged_rows = self._rows.ragged_rows
        number = self._number_rows(len(rows))[kept]
        values = {name: samples[:, self.names.index(name)] for name in self.wanted}
        text = self._rows.take_text()
        return Block(values, number, {name: text[name] for name in self.wanted if name in text})

    def _fill(self, rows: int) -> None:
        """Read messages until so many rows wait, or all have been read."""
        while len(self._waiting) < rows:
            try:
                message = next(self._messages)
            except StopIteration:
                return
            except ValueError as error:
                why = f"{error}; {self._rows_seen} samples were read"
                raise TraceError(f"{self.path}: {why}") from None
            if not isinstance(message, dict):
                continue
            samples, event = message.get(SAMPLES), message.get(EVENT)
            if isinstance(samples, list):
                self._waiting += samples
            if isinstance(event, dict):
                self.context.add_event(event)


def recognises(head: bytes, _path: Path) -> bool:
    """Return whether a file begins as such a recording."""
    start = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    return start.startswith(b"{") and (b'"SignalListHFData"' in head or b'"HFData"' in head)
