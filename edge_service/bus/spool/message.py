"""Messages that wait, and letters that nobody would take."""

from dataclasses import dataclass
from zlib import crc32


class SpoolError(Exception):
    """The file cannot be read or written now; the text is one line."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message.

    Attributes:
        number: rises in the order in which they came.
        topic, payload: what it is about, and what it says.
        key: names it for ever, whatever becomes of it.
        refusals: times that it was refused.
        delays: times that it could not be brought, through no fault of its own.
    """

    number: int
    topic: str
    payload: bytes
    key: str = ""
    refusals: int = 0
    delays: int = 0


@dataclass(frozen=True, slots=True)
class DeadLetter:
    """A message that is tried no more, why, and since when (UNIX time, ns)."""

    key: str
    topic: str
    payload: bytes
    tries: int
    reason: str
    time_ns: int


def checksum(key: str, topic: str, payload: bytes) -> int:
    """Checksum of what must not change on disk."""
    return crc32(payload, crc32(f"{key}\0{topic}\0".encode()))


def is_whole(key: object, topic: object, payload: object, said: object) -> bool:
    """Tell whether these are what was once put on the disk."""
    if isinstance(key, str) and isinstance(topic, str) and isinstance(payload, bytes):
        return checksum(key, topic, payload) == said
    return False
