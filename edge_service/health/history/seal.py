"""A checksum over every byte of a Parquet file, at a place that its readers skip.

Readers find the footer from the end of the file and the pages from the footer, so between them
there is room: `edge-service.sha256`, a space, and the SHA-256 of all other bytes in hex.
"""

import hashlib

from ...atomic import DamagedError

SEAL = b"edge-service.sha256"
"""Also a key of the footer's metadata: a file that names it anywhere has a seal."""
_LENGTH = len(SEAL) + 1 + 64 + 1
_TAIL_BYTES = 8


def sealed(content: bytes) -> bytes:
    """The bytes of a Parquet file with their seal."""
    at = len(content) - _footer_bytes(content)
    return content[:at] + _seal(content) + content[at:]


def is_sealed(content: bytes) -> bool:
    """Tell whether a file is sealed; DamagedError if the seal does not fit."""
    if SEAL not in content:
        return False
    end = len(content) - _footer_bytes(content)
    start = max(end - _LENGTH, 0)
    if content[start:end] != _seal(content[:start] + content[end:]):
        raise DamagedError("its checksum is wrong")
    return True


def _footer_bytes(content: bytes) -> int:
    """Length of the footer with what stands behind it."""
    return int.from_bytes(content[-_TAIL_BYTES:-4], "little") + _TAIL_BYTES


def _seal(content: bytes) -> bytes:
    return SEAL + b" " + hashlib.sha256(content).hexdigest().encode() + b"\n"
