"""The forms of a recording, told apart by their first bytes, and names of what is none.

A stranger should learn what he has opened. The bytes are those of the formats' own specifications,
as file(1) collects them.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from . import parquet
from .columns import TraceError
from .matlab import MAGIC as MAT_5
from .matlab import MatlabSource
from .parquet import ParquetSource
from .sinumerik import edge_json
from .sinumerik.edge_json import EdgeJsonSource
from .sinumerik.signals import ControllerAxis
from .sinumerik.trace import ROOT, SinumerikSource
from .sinumerik.tuning import is_tuning
from .source import BYTE_ORDER_MARK, Source
from .text import TextSource

HEAD_BYTES, TRACE = 1 << 16, f"<{ROOT}".encode()
_ARCHIVE, _CSV = "unpack it first", "export it as CSV"
_PARQUET, _UTF_16 = "write it as Parquet or CSV", "UTF-16 text: save it as UTF-8"
_MAGIC: dict[bytes, str] = {
    b"\x1f\x8b": f"a gzip archive: {_ARCHIVE}",
    b"7z\xbc\xaf\x27\x1c": f"a 7-Zip archive: {_ARCHIVE}",
    b"Rar!\x1a\x07": f"a RAR archive: {_ARCHIVE}",
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": f"an old Excel or Word document: {_CSV}",
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"%PDF": "a PDF document",
    b"MATLAB 7.3 MAT-file": (
        "a MATLAB 7.3 file (HDF5): save it in MATLAB with save('x.mat', '-v7')"
    ),
    b"\x89HDF\r\n\x1a\n": f"an HDF5 file: {_PARQUET}",
    b"SQLite format 3\x00": f"an SQLite database: {_CSV}",
    b"TDSm": f"a TDMS file of LabVIEW: {_CSV}",
    b"MDF     ": f"an MDF measurement: {_CSV}",
    b"ARROW1": f"an Arrow or Feather file: {_PARQUET}",
    b"\x93NUMPY": "a NumPy array: write it with numpy.savetxt and a header",
    b"\x80\x04\x95": f"a Python pickle, which is never opened: {_PARQUET}",
    b"\x89MCAP": "an MCAP file, which is written but not read: keep the CSV or Parquet form",
    b"\xff\xfe": _UTF_16,
    b"\xfe\xff": _UTF_16,
    b"version https://git-lfs": "a Git LFS pointer: fetch the file itself with `git lfs pull`",
}
_ROOT = re.compile(rb"<([A-Za-z_][\w.:-]{0,60})")
_ZIP = "a zip archive or a spreadsheet: unpack it, or export it as CSV"
_ZIPPED = {
    b"xl/": f"an Excel workbook: {_CSV}",
    b"word/": f"a Word document: {_CSV}",
    b"mimetypeapplication/vnd.oasis": f"an OpenDocument: {_CSV}",
}
_LOOKED_AT = 400


@dataclass(frozen=True, slots=True)
class Form:
    """One form of recordings: its name, by which first bytes it is told, and how it is opened."""

    name: str
    recognises: Callable[[bytes, Path], bool]
    open: Callable[[Path, IO[bytes], ControllerAxis], Source]


def open_source(path: Path, axis: ControllerAxis) -> Source:
    """Open a file in the form that its content has. Raises TraceError and OSError."""
    head = head_of(path)
    form = _form(head, path)
    if form is None:
        raise TraceError(f"{path}: no trace but {foreign(head) or 'no text'}")
    file = path.open("rb")
    try:
        return form.open(path, file, axis)
    except BaseException:
        file.close()
        raise


def head_of(path: Path) -> bytes:
    """First bytes of a file. Raises TraceError for a folder, and OSError."""
    if path.exists() and not path.is_file():
        names = ", ".join(form.name for form in FORMS)
        raise TraceError(f"{path}: a folder or device; expected a file: {names}")
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def is_recording(path: Path) -> bool:
    """Return whether a file has the form of a recording. Raises OSError."""
    return path.is_file() and _form(head_of(path), path) is not None


def foreign(head: bytes) -> str | None:
    """Name of the form that the first bytes of a file have; None if they may be text."""
    plain = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    looked = head[:_LOOKED_AT]  # every second byte is zero in UTF-16 text without a mark
    zeros = [looked[start::2].count(0) for start in (0, 1)]
    name: str | None = None
    for magic, named in _MAGIC.items():
        if head.startswith(magic) or plain.startswith(magic):
            return named
    if head.startswith(b"PK\x03\x04"):
        name = next((name for part, name in _ZIPPED.items() if part in head), _ZIP)
    elif head[257:262] == b"ustar":
        name = f"a tar archive: {_ARCHIVE}"
    elif is_tuning(plain) and plain.startswith(b"<"):
        name = "a servo tuning of a SINUMERIK: see `edge-service fingerprint`"
    elif plain.startswith(b"<"):
        root = _ROOT.search(plain)
        name = "an HTML or XML document" + (f" <{root[1].decode()}>" if root else "")
    elif plain.startswith((b"{", b"[{")):
        name = "JSON, and no recording of Industrial Edge (Header, Payload)"
    elif len(looked) > 8 and max(zeros) > 0.8 * len(looked[1::2]) and min(zeros) == 0:
        name = _UTF_16
    return name


FORMS = (
    Form("JSON of Industrial Edge", edge_json.recognises, lambda p, f, _: EdgeJsonSource(p, f)),
    Form("MATLAB 5", lambda head, _: head.startswith(MAT_5), lambda p, f, _: MatlabSource(p, f)),
    Form("Parquet", parquet.recognises, lambda p, f, _: ParquetSource(p, f)),
    Form("SINUMERIK trace XML", lambda head, _: TRACE in head, SinumerikSource),
    Form("text (CSV)", lambda head, _: foreign(head) is None, lambda p, f, _: TextSource(p, f)),
)
"""In the order of asking."""


def _form(head: bytes, path: Path) -> Form | None:
    return next((form for form in FORMS if form.recognises(head, path)), None)
