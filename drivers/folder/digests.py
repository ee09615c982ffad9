"""Digests of contents: what was hashed of a file that grows is not hashed again."""

import hashlib
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

MOST_FILES = 64
_EDGE_BYTES = 4096
_CHUNK_BYTES = 1 << 20


@dataclass(slots=True)
class _Hashed:
    """Progress of the hashing of one file.

    Attributes:
        hasher: of the first `size` bytes.
        edge: the last of them.
        marks: size -> digest of so many bytes.
    """

    inode: int
    hasher: Any = field(default_factory=hashlib.sha256)
    size: int = 0
    edge: bytes = b""
    marks: dict[int, str] = field(default_factory=dict)

    def goes_on_in(self, file: BinaryIO, inode: int, sizes: list[int]) -> bool:
        """Tell whether a file still begins with it, and only the rest is left to hash."""
        if inode != self.inode or any(n < self.size and n not in self.marks for n in sizes):
            return False
        file.seek(self.size - len(self.edge))
        return sizes[-1] >= self.size and file.read(len(self.edge)) == self.edge

    def add(self, chunk: bytes) -> None:
        """Hash further bytes."""
        self.hasher.update(chunk)
        self.size += len(chunk)
        self.edge = (self.edge + chunk[-_EDGE_BYTES:])[-_EDGE_BYTES:]


class Digests:
    """Digests of the files of one folder; the last few are remembered."""

    def __init__(self) -> None:
        self._hashed: OrderedDict[Path, _Hashed] = OrderedDict()
        self.hashed_bytes = 0

    def of(self, path: Path, sizes: set[int]) -> dict[int, str]:
        """SHA-256 of the first bytes of a file, by how many. Raises OSError."""
        wanted = sorted(sizes)
        with path.open("rb") as file:
            inode = path.stat().st_ino
            hashed = self._hashed.pop(path, None)
            if hashed is None or not hashed.goes_on_in(file, inode, wanted):
                hashed = _Hashed(inode)
            file.seek(hashed.size)
            for size in wanted:
                self._hash_up_to(size, hashed, file)
        self._hashed[path] = hashed
        if len(self._hashed) > MOST_FILES:
            self._hashed.popitem(last=False)
        return {size: hashed.marks[size] for size in wanted}

    def _hash_up_to(self, size: int, hashed: _Hashed, file: BinaryIO) -> None:
        while hashed.size < size and (chunk := file.read(min(_CHUNK_BYTES, size - hashed.size))):
            hashed.add(chunk)
            self.hashed_bytes += len(chunk)
        hashed.marks.setdefault(size, hashed.hasher.hexdigest())
