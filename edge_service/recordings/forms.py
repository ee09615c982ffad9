"""The forms of a recording, told apart by their first bytes, and names of what is none.

A stranger should learn what he has opened: `forms.toml` has the bytes by which it is told.
"""

import re
import tomllib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import IO

from . import parquet
from .arranged import open_text
from .columns import TraceError
from .matlab import MAGIC as MAT_5
from .matlab import MatlabSource
from .parquet import ParquetSource
from .sinumerik.edge import EdgeJsonSource, is_edge_json
from .sinumerik.signals import ControllerAxis
from .sinumerik.trace import ROOT, SinumerikSource
from .source import BYTE_ORDER_MARK, Source

HEAD_BYTES, TRACE = 1 << 16, f"<{ROOT}".encode()
_FOREIGN = tomllib.loads((files(__package__) / "forms.toml").read_text("utf-8"))["foreign"]


@dataclass(frozen=True, slots=True)
class Form:
    name: str
    recognises: Callable[[bytes, Path], bool]
    open: Callable[[Path, IO[bytes], ControllerAxis], Source]


def open_source(path: Path, axis: ControllerAxis) -> Source:
    """Open a file in the form that its content has. Raises TraceError and OSError."""
    if any("\udc80" <= letter <= "\udcff" for letter in str(path)):
        raise TraceError(f"{str(path)!a}: a name that is no UTF-8: rename the file")
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


def is_database(source: Path) -> bool:
    with suppress(OSError), source.open("rb") as file:
        return file.read(16) == b"SQLite format 3\0"
    return False


def foreign(head: bytes) -> str | None:
    """Name of the form that the first bytes of a file have; None if they may be text."""
    plain = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    for expression, words in _FOREIGN.items():
        if found := re.match(expression.encode(), plain):
            return found.expand(words.encode()).decode()
    return None


FORMS = (
    Form("JSON of Industrial Edge", is_edge_json, lambda p, f, _: EdgeJsonSource(p, f)),
    Form("MATLAB 5", lambda head, _: head.startswith(MAT_5), lambda p, f, _: MatlabSource(p, f)),
    Form("Parquet", parquet.recognises, lambda p, f, _: ParquetSource(p, f)),
    Form("SINUMERIK trace XML", lambda head, _: TRACE in head, SinumerikSource),
    Form("text (CSV)", lambda head, _: foreign(head) is None, lambda p, f, _: open_text(p, f)),
)
"""In the order of asking."""


def _form(head: bytes, path: Path) -> Form | None:
    return next((form for form in FORMS if form.recognises(head, path)), None)
