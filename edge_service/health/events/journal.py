"""Events on disk: one checked line each, bounded, read back at the start."""

import json
import logging
import zlib
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ...atomic import replaced_file
from .log import LoggedEvent

log = logging.getLogger(__name__)
MOST_EVENTS = 20_000
_EVENTS = TypeAdapter(LoggedEvent)


class EventJournal:
    """A file of events; when it holds twice as many as it should, the older half goes.

    A line is the CRC-32 of the rest in hex, a space, and `{"id": ..., "event": {...}}`. Lines that
    a crash tore or damaged are left out.
    """

    def __init__(self, path: Path, most: int = MOST_EVENTS) -> None:
        self._path = path
        self._most = most
        self._failing = False
        path.parent.mkdir(parents=True, exist_ok=True)
        self.events = _read(path)[-most:]
        """The newest events that were there when it was opened, oldest first."""
        self._lines = len(self.events)
        self._rewrite(self.events)

    def append(self, logged: LoggedEvent) -> None:
        """Keep one event; a full disk is logged once, and must not end what happens now."""
        try:
            self._append(logged)
        except OSError as error:
            if not self._failing:
                log.warning("%s: events cannot be kept (%s)", self._path, error.strerror)
            self._failing = True
        else:
            self._failing = False

    def _append(self, logged: LoggedEvent) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(_line(logged))
        self._lines += 1
        if self._lines >= 2 * self._most:
            kept = _read(self._path)[-self._most :]
            self._rewrite(kept)
            self._lines = len(kept)

    def _rewrite(self, events: list[LoggedEvent]) -> None:
        with replaced_file(self._path) as file:
            file.writelines(map(_line, events))


def _line(logged: LoggedEvent) -> str:
    text = json.dumps(_EVENTS.dump_python(logged, mode="json"), allow_nan=False)
    return f"{zlib.crc32(text.encode()):08x} {text}\n"


def _read(path: Path) -> list[LoggedEvent]:
    if not path.exists():
        return []
    events = []
    for line in path.read_bytes().split(b"\n"):
        check, _, text = line.partition(b" ")
        if not text or check != f"{zlib.crc32(text):08x}".encode():
            continue
        try:
            events.append(_EVENTS.validate_json(text))
        except ValidationError:
            log.warning("%s: an event of another version is left out", path)
    return events
