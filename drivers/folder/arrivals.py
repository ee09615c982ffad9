"""Detection of complete traces among the files of a folder."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..base import DriverUnavailableError

_TAIL_BYTES = 4096
_PARQUET_MAGIC = b"PAR1"


@dataclass(frozen=True, slots=True)
class _Look:
    """Size and time of change of a file, and since when it has had them on the watcher's clock."""

    size: int
    changed_ns: int
    since_s: float


class Arrivals:
    """Watches a folder. A file is complete when it rests and has its proper end.

    Args:
        folder: the folder.
        pattern: of the names.
        settle_s: how long a file must rest.
    """

    def __init__(self, folder: Path, pattern: str, settle_s: float) -> None:
        self._folder, self._pattern, self._settle_s = folder, pattern, settle_s
        self._looks: dict[Path, _Look] = {}
        self._told: dict[Path, _Look] = {}

    def complete(self, now_s: float) -> list[Path]:
        """Files that have become complete since the last call, the oldest first.

        Raises:
            DriverUnavailableError: the folder cannot be looked into.
        """
        found = {path: self._look(path, *state, now_s) for path, state in self._states()}
        self._looks = found
        self._told = {path: look for path, look in self._told.items() if path in found}
        ready = [
            (look.changed_ns, path)
            for path, look in found.items()
            if now_s - look.since_s >= self._settle_s
            and self._told.get(path) != look
            and has_proper_end(path)
        ]
        self._told |= {path: found[path] for _, path in ready}
        return [path for _, path in sorted(ready)]

    def _states(self) -> Iterator[tuple[Path, tuple[int, int]]]:
        try:
            if not self._folder.is_dir():
                raise DriverUnavailableError(f"{self._folder}: no such folder")
            for path in self._folder.glob(self._pattern):
                if not path.name.startswith(".") and path.is_file():
                    state = path.stat()
                    yield path, (state.st_size, state.st_mtime_ns)
        except OSError as error:
            raise DriverUnavailableError(f"{self._folder}: {error.strerror}") from None

    def _look(self, path: Path, size: int, changed_ns: int, now_s: float) -> _Look:
        before = self._looks.get(path)
        if before is not None and (before.size, before.changed_ns) == (size, changed_ns):
            return before
        return _Look(size, changed_ns, now_s)


def has_proper_end(path: Path) -> bool:
    """Tell whether a file ends as its form demands: closing tag, magic bytes, end of a line."""
    try:
        with path.open("rb") as file:
            head = file.read(_TAIL_BYTES)
            file.seek(max(path.stat().st_size - _TAIL_BYTES, 0))
            tail = file.read().rstrip(b" \t\0")
    except OSError:
        return False
    if head.startswith(_PARQUET_MAGIC):
        return tail.endswith(_PARQUET_MAGIC) and len(tail) > len(_PARQUET_MAGIC)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return tail.rstrip().endswith(b"</traceSession>")
    return tail.endswith((b"\n", b"\r"))
