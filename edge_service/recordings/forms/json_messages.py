"""A JSON object with one long list, read element by element in bounded memory."""

import codecs
import json
from typing import Any, BinaryIO

CHUNK_BYTES = 1 << 18
LONGEST_ELEMENT = 1 << 25
_SPACE = " \t\r\n"


class JsonError(Exception):
    """JSON that is cut off or damaged, or another than expected; the text is one line."""


class JsonMessages:
    """Members of the object up to the list, then its elements one by one.

    Args:
        file: at its start.
        list_name: of the long list.

    Raises:
        JsonError: there is no such list.
    """

    def __init__(self, file: BinaryIO, list_name: str) -> None:
        self.members: dict[str, Any] = {}
        self._file = file
        self._text, self._position, self._passed = "", 0, 0
        self._ended = False
        self._decoder = codecs.getincrementaldecoder("utf-8-sig")("replace")
        self._json = json.JSONDecoder()
        self._done = False
        self._first = True
        self._expect("{")
        self._open_list(list_name)

    def next(self) -> Any:
        """The next element; StopIteration at the end of the list. Raises JsonError."""
        if not self._done:
            if self._peek() == "]":
                self._done = True
            elif not self._first:
                self._expect(",")
        if self._done:
            raise StopIteration
        self._first = False
        return self._value()

    def _open_list(self, name: str) -> None:
        while self._peek() != "}":
            key = self._value()
            self._expect(":")
            if key == name and self._peek() == "[":
                self._expect("[")
                return
            if not isinstance(key, str) or len(self.members) > 100:
                break
            self.members[key] = self._value()
            if self._peek() == ",":
                self._expect(",")
        raise JsonError(f"no list {name!r}")

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
