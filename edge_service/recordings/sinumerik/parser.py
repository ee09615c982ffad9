"""The XML of a SINUMERIK "Solution Line Trace", record by record in bounded memory."""

import codecs
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from xml.parsers import expat

from ..columns import TraceError

CHUNK_BYTES = 1 << 18
LONGEST_ELEMENT_BYTES = 1 << 22
LONGEST_INTERVAL_S = 1e6
DEEPEST = 32
MOST_SIGNALS = 4096
ENCODINGS = {"utf-8", "us-ascii", "iso-8859-1", "iso-8859-15", "windows-1252"}
ROOT = "traceSession"
_DECLARED = re.compile(rb"""\A\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True, slots=True)
class DataSignal:
    """One `<dataSignal>`: id of its attribute, name, unit, interval in s, number of samples."""

    key: str
    name: str
    units_type: str
    interval_s: float
    count: int | None


@dataclass(slots=True)
class DataFrame:
    """One `<dataFrame>`: what its `<frameHeader>` says, and its signals by id.

    Attributes:
        number: from 1.
        start_time: wall-clock time as it stands there; empty where it does not.
        stop_s: time of the last sample, s; None where it does not say.
        drop_outs: how often the controller lost samples.
    """

    number: int
    start_time: str = ""
    stop_s: float | None = None
    drop_outs: int = 0
    signals: dict[str, DataSignal] = field(default_factory=dict)


Record = tuple[DataFrame, dict[str, str]]
"""A `<rec>`: its frame and its attributes."""


class SinumerikParser:
    """Reads an open file from its start.

    A document type is refused, and with it every entity: a trace has none, and entities are how a
    small hostile file grows without bound or reads other files. Bytes that are no text (names in
    another encoding than declared) are replaced, as they stand in descriptions only.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self.finished = False
        self.frames: list[DataFrame] = []
        self._file = file
        self._records: list[Record] = []
        self._records_read = 0
        self._read_up_to = ""
        self._depth = 0
        self._bytes_fed = 0
        head = file.read(CHUNK_BYTES)
        self._decoder = text_decoder(path, head)
        self._parser = expat.ParserCreate("utf-8")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._parser.EntityDeclHandler = self._refuse_document_type
        self._head = head.removeprefix(_BYTE_ORDER_MARK)

    def read(self) -> list[Record]:
        """Records of the next piece of the file; sets `finished` at its end. Raises TraceError."""
        self._records = []
        raw = self._head or self._file.read(CHUNK_BYTES)
        self._head = b""
        self.finished = not raw
        text = self._decoder.decode(raw, self.finished).encode()
        self._bytes_fed += len(text)
        try:
            self._parser.Parse(text, self.finished)
        except expat.ExpatError as error:
            self._count()
            raise self._broken(error) from None
        if self._bytes_fed - self._parser.CurrentByteIndex > LONGEST_ELEMENT_BYTES:
            raise TraceError(f"{self.path}: an element of more than {LONGEST_ELEMENT_BYTES} bytes")
        self._count()
        return self._records

    def _count(self) -> None:
        if self._records:
            self._records_read += len(self._records)
            self._read_up_to = f" up to {self._records[-1][1].get('time', '?')[:20]} s"

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            raise TraceError(f"{self.path}: elements more than {DEEPEST} deep; expected a trace")
        if name == "rec" and self.frames:
            self._records.append((self.frames[-1], attributes))
        elif self._depth == 1 and name != ROOT:
            raise TraceError(
                f"{self.path}: no trace but an HTML or XML document <{name[:40]}>; "
                f"expected <{ROOT}>, a SINUMERIK Solution Line Trace"
            )
        elif name == "dataFrame":
            self.frames.append(DataFrame(len(self.frames) + 1))
        elif name == "frameHeader" and self.frames:
            self._read_header(attributes)
        elif name == "dataSignal" and self.frames:
            self._read_signal(attributes)

    def _end(self, _name: str) -> None:
        self._depth -= 1

    def _refuse_document_type(self, *_: object) -> None:
        raise TraceError(
            f"{self.path}: declares a document type or entities; refused, as no trace has them"
        )

    def _read_header(self, attributes: dict[str, str]) -> None:
        frame = self.frames[-1]
        frame.start_time = attributes.get("startTime", "")
        frame.stop_s = _number(attributes.get("stopInc")) or None
        frame.drop_outs = int(_number(attributes.get("dropOuts")) or 0)

    def _read_signal(self, attributes: dict[str, str]) -> None:
        signals = self.frames[-1].signals
        key = attributes.get("id", "")
        name = attributes.get("name") or key
        interval_s = _number(attributes.get("interval"))
        if not key or interval_s is None or not 0.0 < interval_s <= LONGEST_INTERVAL_S:
            raise TraceError(
                f"{self.path}: signal {name[:80]!r}: id {key[:40]!r}, interval "
                f"{attributes.get('interval', '')[:40]!r}; expected an id and seconds above 0"
            )
        if len(signals) >= MOST_SIGNALS:
            raise TraceError(f"{self.path}: more than {MOST_SIGNALS} signals in one frame")
        count = _number(attributes.get("datapointCount"))
        signals[key] = DataSignal(
            key,
            name,
            attributes.get("unitsType", ""),
            interval_s,
            int(count) if count is not None and count >= 1.0 else None,
        )

    def _broken(self, error: expat.ExpatError) -> TraceError:
        return TraceError(
            f"{self.path}: line {error.lineno}, column {error.offset + 1}: cut off or damaged "
            f"({expat.ErrorString(error.code)}); {self._records_read} records were read"
            f"{self._read_up_to}"
        )


def text_decoder(path: Path, head: bytes) -> codecs.IncrementalDecoder:
    """Decoder of the declared encoding, UTF-8 by default, that replaces what is no text."""
    declared = _DECLARED.match(head.removeprefix(_BYTE_ORDER_MARK))
    encoding = declared[1].decode().lower() if declared else "utf-8"
    if encoding not in ENCODINGS:
        raise TraceError(f"{path}: encoding {encoding!r}; expected {', '.join(sorted(ENCODINGS))}")
    return codecs.getincrementaldecoder(encoding)("replace")


def _number(text: str | None) -> float | None:
    """A finite number, or None."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None
