"""XML of strangers, fed to expat in bounded memory."""

import codecs
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO
from xml.parsers import expat

from ..columns import TraceError
from ..source import BYTE_ORDER_MARK

CHUNK_BYTES = 1 << 18
LONGEST_ELEMENT_BYTES = 1 << 22
DEEPEST = 64
ENCODINGS = {"utf-8", "us-ascii", "iso-8859-1", "iso-8859-15", "windows-1252"}
_DECLARED = re.compile(rb"""\A\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")


class XmlReader:
    """Reads an open file from its start, piece by piece.

    A document type is refused, and with it every entity: entities are how a small hostile file
    grows without bound or reads other files. Bytes that are no text (names in another encoding
    than declared) are replaced.

    Args:
        start, end, characters: called as those of expat.
        so_far: what has been read, in words for a message of damage.
    """

    def __init__(
        self,
        path: Path,
        file: IO[bytes],
        start: Callable[[str, dict[str, str]], object],
        end: Callable[[str], object] = lambda _tag: None,
        characters: Callable[[str], object] | None = None,
        so_far: Callable[[], str] = str,
    ) -> None:
        self._path, self._file, self._so_far = path, file, so_far
        self._depth = self._bytes_fed = 0
        self._head = file.read(CHUNK_BYTES).removeprefix(BYTE_ORDER_MARK)
        declared = _DECLARED.match(self._head)
        encoding = declared[1].decode().lower() if declared else "utf-8"
        if encoding not in ENCODINGS:
            expected = ", ".join(sorted(ENCODINGS))
            raise TraceError(f"{path}: encoding {encoding!r}; expected {expected}")
        self._decoder = codecs.getincrementaldecoder(encoding)("replace")

        def deeper(tag: str, attributes: dict[str, str]) -> None:
            self._depth += 1
            if self._depth > DEEPEST:
                raise TraceError(f"{path}: elements more than {DEEPEST} deep")
            start(tag, attributes)

        def higher(tag: str) -> None:
            self._depth -= 1
            end(tag)

        def refuse(*_: object) -> None:
            raise TraceError(f"{path}: declares a document type or entities; refused")

        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler, self._parser.EndElementHandler = deeper, higher
        self._parser.StartDoctypeDeclHandler = self._parser.EntityDeclHandler = refuse
        if characters is not None:
            self._parser.buffer_text = True
            self._parser.CharacterDataHandler = characters

    def feed(self) -> bool:
        """Read the next piece of the file; False at its end. Raises TraceError."""
        raw = self._head or self._file.read(CHUNK_BYTES)
        self._head = b""
        text = self._decoder.decode(raw, not raw).encode()
        self._bytes_fed += len(text)
        try:
            self._parser.Parse(text, not raw)
        except expat.ExpatError as error:
            raise TraceError(
                f"{self._path}: line {error.lineno}, column {error.offset + 1}: cut off or damaged "
                f"({expat.ErrorString(error.code)}){self._so_far()}"
            ) from None
        if self._bytes_fed - self._parser.CurrentByteIndex > LONGEST_ELEMENT_BYTES:
            raise TraceError(f"{self._path}: an element of more than {LONGEST_ELEMENT_BYTES} bytes")
        return bool(raw)
