"""Names of what is no recording, by its first bytes: a stranger should learn what he has opened.

The bytes are those of the formats' own specifications, as file(1) collects them.
"""

import re

from ..sinumerik.tuning import is_tuning

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
ARCHIVE = "unpack it first"
CSV = "export it as CSV"
PARQUET = "convert it to Parquet or CSV"
WIDE = "UTF-16 text: save it as UTF-8"
_MAGIC: tuple[tuple[bytes, str], ...] = (
    (b"\x1f\x8b", f"a gzip archive: {ARCHIVE}"),
    (b"BZh", f"a bzip2 archive: {ARCHIVE}"),
    (b"\xfd7zXZ\x00", f"an xz archive: {ARCHIVE}"),
    (b"\x28\xb5\x2f\xfd", f"a zstd archive: {ARCHIVE}"),
    (b"7z\xbc\xaf\x27\x1c", f"a 7-Zip archive: {ARCHIVE}"),
    (b"Rar!\x1a\x07", f"a RAR archive: {ARCHIVE}"),
    (b"PK\x05\x06", "an empty zip archive"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", f"an old Excel or Word document: {CSV}"),
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"II*\x00", "a TIFF image"),
    (b"MM\x00*", "a TIFF image"),
    (b"%PDF", "a PDF document"),
    (b"{\\rtf", f"a document in rich text: {CSV}"),
    (
        b"MATLAB 7.3 MAT-file",
        "a MATLAB 7.3 file (HDF5): save it in MATLAB with save('x.mat', '-v7')",
    ),
    (b"\x89HDF\r\n\x1a\n", f"an HDF5 file: {PARQUET}"),
    (b"CDF\x01", f"a NetCDF file: {PARQUET}"),
    (b"CDF\x02", f"a NetCDF file: {PARQUET}"),
    (b"SQLite format 3\x00", f"an SQLite database: {CSV}"),
    (b"TDSm", f"a TDMS file of LabVIEW: {CSV}"),
    (b"MDF     ", f"an MDF measurement: {CSV}"),
    (b"UnFinMF ", f"an unfinished MDF measurement: {CSV}"),
    (b"LOGG", f"a BLF log of a bus: {CSV}"),
    (b"ARROW1", "an Arrow or Feather file: write it as Parquet"),
    (b"ORC", "an ORC file: write it as Parquet"),
    (b"Obj\x01", "an Avro file: write it as Parquet"),
    (b"\x93NUMPY", "a NumPy array: write it with numpy.savetxt and a header"),
    (b"\x80\x04\x95", "a Python pickle, which is never opened: write it as Parquet or CSV"),
    (b"\x89MCAP", "an MCAP file, which is written but not read: keep the CSV or Parquet form"),
    (b"\xff\xfe\x00\x00", "UTF-32 text: save it as UTF-8"),
    (b"\xff\xfe", WIDE),
    (b"\xfe\xff", WIDE),
    (b"\x7fELF", "no text but a program"),
    (b"MZ\x90\x00", "no text but a program of Windows"),
    (b"version https://git-lfs", "a Git LFS pointer: fetch the file itself with `git lfs pull`"),
)
_ROOT = re.compile(rb"<([A-Za-z_][\w.:-]{0,60})")
_MEDIA = {b"WAVE": "a WAV sound", b"AVI ": "a video"}
_TAR = 257
_LOOKED_AT = 400


def foreign(head: bytes) -> str | None:
    """Name of the form that the first bytes of a file have; None if they may be text."""
    plain = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    for magic, name in _MAGIC:
        if head.startswith(magic) or plain.startswith(magic):
            return name
    return _container(head) or _written(plain) or (WIDE if _is_wide(head) else None)


def named(head: bytes) -> str:
    """As `foreign`, with a name for everything."""
    return foreign(head) or "no text"


def _container(head: bytes) -> str | None:
    if head.startswith(b"PK\x03\x04"):
        return _zip(head)
    if head.startswith(b"RIFF"):
        return _MEDIA.get(head[8:12], "a RIFF file")
    return f"a tar archive: {ARCHIVE}" if head[_TAR : _TAR + 5] == b"ustar" else None


def _written(plain: bytes) -> str | None:
    if plain.startswith(b"<"):
        return _markup(plain)
    if plain.startswith((b"{", b"[{")):
        return "JSON, and no recording of Industrial Edge (Header, Payload)"
    return None


def _zip(head: bytes) -> str:
    """A zip archive, or what office programs keep in one."""
    for part, kind in ((b"xl/", "an Excel workbook"), (b"word/", "a Word document")):
        if part in head:
            return f"{kind}: {CSV}"
    if b"mimetypeapplication/vnd.oasis" in head:
        return f"an OpenDocument: {CSV}"
    return "a zip archive or a spreadsheet: unpack it, or export it as CSV"


def _markup(plain: bytes) -> str:
    """An HTML or XML document, by its root element."""
    if is_tuning(plain):
        return "a servo tuning of a SINUMERIK: see `edge-service response`"
    found = _ROOT.search(plain)
    root = f" <{found[1].decode()}>" if found else ""
    return f"an HTML or XML document{root}"


def _is_wide(head: bytes) -> bool:
    """Tell whether every second byte is zero, as in UTF-16 text without a mark."""
    looked = head[:_LOOKED_AT]
    halves = looked[0::2], looked[1::2]
    zeros = [half.count(0) for half in halves]
    return len(looked) > 8 and max(zeros) > 0.8 * len(halves[1]) and min(zeros) == 0
