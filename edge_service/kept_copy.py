"""Copy of an SQLite file, a day old at most; it ends with its own digest, so damage of it is seen.

SQLite reads a copy with its last line, since the head of the file says where the pages end.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

from .atomic import set_aside, sync_file, sync_folder

PERIOD_S = 86400.0
_MARK = b"\nsha256 "
_SEAL_BYTES = len(_MARK) + 64
_CHUNK_BYTES = 1 << 20


class KeptCopy:
    """The copy beside a file, under the same name with `.copy`.

    Args:
        original: the SQLite file.
    """

    def __init__(self, original: Path) -> None:
        self.path = original.with_name(f"{original.stem}.copy{original.suffix}")
        self._is_checked = False

    def exists(self) -> bool:
        """True if something stands in its place."""
        return os.path.lexists(self.path)

    def cleared_of_damage(self) -> str:
        """Set the copy aside if it is not what was made, once after a start; says so. OSError."""
        if self._is_checked or not self.exists():
            return ""
        damage = self._damage()
        aside = f"{self.path}: {damage}; kept as {set_aside(self.path).name}" if damage else ""
        self._is_checked = True
        return aside

    def is_due(self, now_s: float) -> bool:
        """True if there is none, or none that is young enough. Raises OSError."""
        if not self.exists():
            return True
        return not 0.0 <= now_s - self.path.stat().st_mtime < PERIOD_S

    def make(self, write: Callable[[Path], object]) -> None:
        """Put a new copy, which `write` makes, in place of the old one. Raises OSError."""
        part = self.path.with_name(f".{self.path.name}.part")
        part.unlink(missing_ok=True)
        write(part)
        digest = _digest(part, part.stat().st_size)
        with part.open("ab") as file:
            file.write(_MARK + digest)
        sync_file(part)
        part.replace(self.path)
        sync_folder(self.path.parent)

    def _damage(self) -> str:
        if not self.path.is_file():
            return "it is no file"
        length = max(self.path.stat().st_size - _SEAL_BYTES, 0)
        with self.path.open("rb") as file:
            file.seek(length)
            seal = file.read()
        return "" if seal == _MARK + _digest(self.path, length) else "its digest is wrong"


def _digest(path: Path, length: int) -> bytes:
    """SHA-256 in hexadecimal of the first bytes of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while content := file.read(min(length, _CHUNK_BYTES)):
            digest.update(content)
            length -= len(content)
    return digest.hexdigest().encode()
