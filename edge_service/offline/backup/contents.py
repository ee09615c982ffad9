"""Contents of a backup: a ZIP archive without compression, and a manifest that it must fit."""

from pathlib import PurePosixPath
from typing import Literal

from ...messages.estimate import Frozen
from ...nodes.stores.history_store import UNFINISHED

MANIFEST = "manifest.json"
CONFIG, HISTORY = "config", "history"
SCHEMA: Literal["backup/1"] = "backup/1"
LOCK = "@lock"


class BackupError(Exception):
    """Reason why nothing was backed up or restored; the text is one line."""


class KeptFile(Frozen):
    """One file of a backup.

    Attributes:
        length: bytes.
        sha256: of its content, hexadecimal.
        mode: permissions.
        user, group: names of its owners; empty where they have none.
    """

    length: int
    sha256: str
    mode: int
    user: str = ""
    group: str = ""


class Manifest(Frozen):
    """Description of a backup.

    Attributes:
        format: of the archive.
        version: of the service that made it.
        made: time, UTC, ISO 8601.
        config: name of the configuration file.
        history: history folder as it was; None if the history was in memory.
        files: by name in the archive, `config/...` and `history/...`.
    """

    format: Literal["backup/1"] = SCHEMA
    version: str
    made: str
    config: str
    history: str | None
    files: dict[str, KeptFile]


def check_name(name: str) -> None:
    """Check the name of a file in an archive; raise BackupError if it could lead elsewhere."""
    parts = name.split("/")
    is_plain = len(parts) > 1 and str(PurePosixPath(name)) == name and ".." not in parts
    inside = is_plain and parts[0] in (CONFIG, HISTORY) and name.isprintable()
    if not inside or parts[1] in (LOCK, UNFINISHED):
        raise BackupError(f"{name!r:.80} is no name of a file of a backup")
