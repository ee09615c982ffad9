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
LONGEST_ELEMENT = 1 << 23
_SPACE = " \t\r\n"


class JsonError(Exception):
    """JSON that is cut off or damaged, or another than expected; the text is one line."""


class JsonText:
    """Values of a JSON text one by one, in bounded memory."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._text, self._position, self._passed = "", 0, 0
        self._ended = False
        self._decoder = codecs.getincrementaldecoder("utf-8-sig")("replace")
        self._json = json.JSONDecoder()

    def elements(self, name: str, members: dict[str, Any]) -> Iterator[Any]:
        """Elements of the list `name` of the outermost object; `members` takes those before it.

        Raises JsonError.
        """
        self._expect("{")
        while self._peek() != "}":
            key = self._value()
            self._expect(":")
            if key == name and self._peek() == "[":
                break
            if not isinstance(key, str) or len(members) > 100:
                raise JsonError(f"no list {name!r}")
            members[key] = self._value()
            if self._peek() == ",":
                self._expect(",")
        else:
            raise JsonError(f"no list {name!r}")
        self._expect("[")
        while self._peek() != "]":
            yield self._value()
            if self._peek() != "]":
                self._expect(",")

    def _expect(self, mark: str) -> None:
        if self._peek() != mark:
            raise self._damaged(f"no {mark!r}")
        self._position += 1

    def _peek(self) -> str:
        """The next character that is no space; empty at the end."""
        while True:
            while self._position < len(self._text) and self._text[self._position] in _SPACE:
                self._position += 1
            if self._position < len(self._text):
                return self._text[self._position]
            if not self._more(CHUNK_BYTES):
                return ""

    def _value(self) -> Any:
        self._peek()
        while True:
            try:
                value, end = self._json.raw_decode(self._text, self._position)
            except RecursionError:
                raise JsonError("its values are nested too deeply") from None
            except ValueError as error:
                if not self._more(max(len(self._text) - self._position, CHUNK_BYTES)):
                    raise self._damaged(str(error)) from None
                continue
            if end == len(self._text) and self._more(CHUNK_BYTES):
                continue  # a number may go on
            self._position = end
            return value

    def _more(self, size: int) -> bool:
        """Read on; False at the end of the file."""
        if self._ended:
            return False
        if len(self._text) - self._position > LONGEST_ELEMENT:
            raise JsonError(f"an element of more than {LONGEST_ELEMENT} characters")
        raw = self._file.read(size)
        self._ended = not raw
        self._passed += self._position
        self._text = self._text[self._position :] + self._decoder.decode(raw, self._ended)
        self._position = 0
        return not self._ended

    def _damaged(self, reason: str) -> JsonError:
        place = self._passed + self._position
        return JsonError(f"cut off or damaged behind character {place} ({reason[:60]})")


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
            except JsonError as error:
                raise TraceError(
                    f"{self.path}: {error}; {self._rows_seen} samples were read"
                ) from None
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
