"""Record on disk of what has been read: a trace is read once, even across restarts."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from edge_service.atomic import replaced_file

from ..base import DriverMisconfiguredError


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
    """

    digest: str
    name: str
    rows: int = 0
    done: bool = False
    problem: str = ""
    size: int = 0


class Ledger:
    """Entries by digest, in a file that is replaced as a whole.

    Raises:
        DriverMisconfiguredError: the file cannot be read or written, or is something else.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._entries = _read(path)

    def entry(self, digest: str, name: str, size: int) -> Entry:
        """The entry of a trace; a new one where it has not been seen."""
        return self._entries.setdefault(digest, Entry(digest, name, size=size))

    def shorter(self, name: str, size: int) -> list[Entry]:
        """Entries of that name that had less content."""
        return [e for e in self._entries.values() if e.name == name and 0 < e.size < size]

    def save(self) -> None:
        """Write all entries."""
        try:
            with replaced_file(self._path) as file:
                json.dump([asdict(entry) for entry in self._entries.values()], file, indent=1)
        except OSError as error:
            raise _wrong(self._path, f"cannot be written ({error.strerror})") from None


def _read(path: Path) -> dict[str, Entry]:
    try:
        listed = json.loads(path.read_text(encoding="utf-8"))
        entries = [Entry(**each) for each in listed]
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise _wrong(path, f"cannot be read ({error.strerror})") from None
    except (ValueError, TypeError):
        raise _wrong(path, "is no ledger of this driver; expected another file") from None
    return {entry.digest: entry for entry in entries}


def _wrong(path: Path, problem: str) -> DriverMisconfiguredError:
    return DriverMisconfiguredError("ledger", f"{path}: {problem}")
