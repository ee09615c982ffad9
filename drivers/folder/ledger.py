"""Record on disk of what has been read: a trace is read once, even across restarts."""

import json
import logging
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from edge_service.atomic import DamagedError, read_checked, set_aside, write_checked

from ..base import DriverMisconfiguredError, DriverUnavailableError

log = logging.getLogger(__name__)
MOST_BEGINNINGS = 16
"""Kept shorter contents of one file that grows."""
_DIGEST = re.compile(r"[0-9a-f]{64}")
_MARKS = ('"digest"', '{"sha256"')
"""One of them stands in every ledger that holds anything."""


@dataclass(slots=True)
class Entry:
    """One trace, known by its content: neither another name nor another date makes it new.

    Attributes:
        digest: SHA-256 of the content.
        size: of the content, bytes; 0 where it was not written down.
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
        DriverMisconfiguredError: the file is something else.
        DriverUnavailableError: it cannot be read now.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unsaved = 0
        self._entries = {entry.digest: entry for entry in _read(path)}
        self._by_name: dict[str, list[Entry]] = defaultdict(list)
        for entry in self._entries.values():
            self._by_name[entry.name].append(entry)

    def entry(self, digest: str, name: str, size: int) -> Entry:
        """The entry of a trace; a new one where it has not been seen."""
        known = self._entries.get(digest)
        if known is None:
            known = self._entries[digest] = Entry(digest, name, size=size)
            self._by_name[name].append(known)
        return known

    def shorter(self, name: str, size: int) -> list[Entry]:
        """Entries of that name that had less content."""
        return [each for each in self._by_name.get(name, ()) if 0 < each.size < size]

    def note_grown(self, beginnings: list[Entry]) -> None:
        """Note that a file has grown beyond these; the oldest of too many are forgotten."""
        for entry in beginnings:
            entry.grown = True
        for name in {entry.name for entry in beginnings}:
            old = [each for each in self._by_name[name] if each.grown][:-MOST_BEGINNINGS]
            for entry in old:
                self._by_name[name].remove(entry)
                del self._entries[entry.digest]

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


def _read(path: Path) -> list[Entry]:
    try:
        content = read_checked(path)
        return [] if content is None else [Entry(**each) for each in json.loads(content)]
    except OSError as error:
        raise DriverUnavailableError(f"{path}: cannot be read ({error.strerror})") from None
    except (DamagedError, ValueError, TypeError):
        return _saved(path)


def _saved(path: Path) -> list[Entry]:
    """Entries that can be read of a damaged ledger, which is set aside."""
    try:
        text = path.read_text("utf-8", errors="replace")
        if text.strip("\0 \n") and not any(mark in text for mark in _MARKS):
            problem = f"{path}: is no ledger of this driver; expected another file"
            raise DriverMisconfiguredError("ledger", problem)
        entries = list(_finished(text))
        aside = set_aside(path)
    except OSError as error:
        raise DriverUnavailableError(f"{path}: is damaged, and stays ({error.strerror})") from None
    log.warning(
        "%s: damaged; set aside as %s, %d traces are known from it", path, aside.name, len(entries)
    )
    return entries


def _finished(text: str) -> Iterator[Entry]:
    """Entries of a damaged text that are whole and that nothing is left to read of."""
    decoder = json.JSONDecoder()
    for found in re.finditer(r'\{\s*"digest"', text):
        try:
            entry = Entry(**decoder.raw_decode(text, found.start())[0])
        except (ValueError, TypeError, RecursionError):
            continue
        if entry.done is True and _DIGEST.fullmatch(str(entry.digest)):
            yield entry
