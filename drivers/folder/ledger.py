"""Record on disk of what has been read: a trace is read once, even across restarts."""

import hashlib
import json
import logging
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from edge_service.atomic import DamagedError, read_checked, set_aside, write_checked

from ..base import DriverUnavailableError

log = logging.getLogger(__name__)
MOST_BEGINNINGS = 16
"""Kept shorter contents of one file that grows."""
_CHUNK_BYTES = 1 << 20


@dataclass(slots=True)
class Entry:
    """One trace, known by its content: neither another name nor another date makes it new.

    Attributes:
        digest: SHA-256 of the content.
        size: of the content, bytes.
        name: of the file when it was first seen.
        rows: handed out so far.
        done: nothing is left to read.
        problem: why the rest of it cannot be read; empty if it can.
        grown: the file has grown since; a later entry says more.
    """

    digest: str
    name: str
    rows: int = 0
    done: bool = False
    problem: str = ""
    size: int = 0
    grown: bool = False


class Ledger:
    """Entries by digest, in a file that is replaced as a whole and carries its own digest.

    A damaged file is set aside, and what can be read of it stands. One that cannot be written is
    told once; what is read meanwhile stays in memory, and is written as soon as that can be.

    Attributes:
        unsaved: times in a row that the file could not be written.

    Raises:
        DriverUnavailableError: it cannot be read now.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unsaved = 0
        try:
            content = read_checked(path)
            entries = [] if content is None else [Entry(**each) for each in json.loads(content)]
        except OSError as error:
            raise DriverUnavailableError(f"{path}: cannot be read ({error.strerror})") from None
        except (DamagedError, ValueError, TypeError):
            entries = _saved(path)
        self._entries = {entry.digest: entry for entry in entries}

    def entry_of(self, path: Path) -> Entry:
        """The entry of a trace; a new one where it has not been seen. Raises OSError.

        One that begins with what was read of a file of its name goes on behind that.
        """
        size = path.stat().st_size
        shorter = [
            each
            for each in self._entries.values()
            if each.name == path.name and 0 < each.size < size
        ]
        digests = _digests(path, sorted({size, *(each.size for each in shorter)}))
        entry = self._entries.setdefault(digests[size], Entry(digests[size], path.name, size=size))
        if entry.rows == 0 and not entry.done:
            beginnings = [each for each in shorter if digests[each.size] == each.digest]
            entry.rows = max((each.rows for each in beginnings), default=0)
            for each in beginnings:
                each.grown = True
            for each in [each for each in beginnings if each.grown][:-MOST_BEGINNINGS]:
                del self._entries[each.digest]
        return entry

    def save(self) -> None:
        """Write all entries, if that can be."""
        content = json.dumps([asdict(entry) for entry in self._entries.values()])
        try:
            write_checked(self._path, content)
        except OSError as error:
            if not self.unsaved:
                log.warning("%s: cannot be written (%s)", self._path, error.strerror)
            self.unsaved += 1
        else:
            if self.unsaved:
                log.info("%s: is written again", self._path)
            self.unsaved = 0


def _digests(path: Path, sizes: list[int]) -> dict[int, str]:
    """SHA-256 of the first bytes of a file, by how many; sizes rise. Raises OSError."""
    hasher, position, digests = hashlib.sha256(), 0, {}
    with path.open("rb") as file:
        for size in sizes:
            while chunk := file.read(min(_CHUNK_BYTES, size - position)):
                hasher.update(chunk)
                position += len(chunk)
            digests[size] = hasher.hexdigest()
    return digests


def _saved(path: Path) -> list[Entry]:
    """Finished entries that can be read of a damaged ledger, which is set aside."""
    try:
        text = path.read_text("utf-8", errors="replace")
        aside = set_aside(path)
    except OSError as error:
        raise DriverUnavailableError(f"{path}: is damaged, and stays ({error.strerror})") from None
    entries = [entry for entry in _whole_entries(text) if entry.done is True]
    log.warning(
        "%s: damaged; set aside as %s, %d traces are known from it", path, aside.name, len(entries)
    )
    return entries


def _whole_entries(text: str) -> Iterator[Entry]:
    decoder: Any = json.JSONDecoder()
    for found in re.finditer(r'\{\s*"digest"', text):
        try:
            entry = Entry(**decoder.raw_decode(text, found.start())[0])
        except (ValueError, TypeError, RecursionError):
            continue
        if re.fullmatch(r"[0-9a-f]{64}", str(entry.digest)):
            yield entry
