"""Events that earlier versions kept: one checked line each in a text file, taken over once."""

import logging
import zlib
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from .log import LoggedEvent

log = logging.getLogger(__name__)
_EVENTS = TypeAdapter(LoggedEvent)


def read_journal(path: Path) -> list[LoggedEvent]:
    """Events of a journal, oldest first; a damaged line is named and left out. Raises OSError."""
    events = []
    for number, line in enumerate(path.read_bytes().splitlines(), start=1):
        check, _, text = line.partition(b" ")
        try:
            if check != f"{zlib.crc32(text):08x}".encode():
                raise ValueError
            events.append(_EVENTS.validate_json(text))
        except (ValidationError, ValueError):
            log.warning("%s: line %d is damaged and left out", path, number)
    return events
