"""`edge-service backup`: a copy of configuration and history while the service runs."""

import grp
import hashlib
import os
import pwd
import shutil
import sqlite3
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO
from zipfile import ZipFile

from ... import __version__
from ...atomic import PART, PRIVATE, replaced_bytes
from ...command_answer import Answer
from ...config import load_config
from ..document import Document
from .contents import (
    CONFIG,
    HISTORY,
    LOCK,
    MANIFEST,
    BackupError,
    KeptFile,
    Manifest,
)

_RECORDINGS = "@recordings"
_LEFT_OUT = {LOCK, "@diary.copy.sqlite", "@bus"}
"""Names in a history folder that the next start makes anew."""
_DATABASE = ".sqlite"
_ELSEWHERE = ("-wal", "-shm", "-journal", ".lock", PART)
"""Ends of names of what belongs to a running process."""
_MOST_PASSES = 10


class BackedUp(Document):
    """A backup; files that the configuration names and that lie elsewhere are left out."""

    out: str
    size_mb: float
    left_out: list[str]


def back_up(config: Path, out: Path, *, recordings: bool = False) -> Answer:
    """Write a backup of the service with this configuration.

    Raises:
        ConfigError: the configuration is wrong.
        BackupError: something cannot be read or written; then nothing was.
    """
    history = load_config(config).history.folder
    try:
        with replaced_bytes(out, PRIVATE) as file:
            outside = _write(file, config, history, recordings=recordings)
    except OSError as error:
        raise BackupError(f"{error.filename or out}: {error.strerror}") from None
    except sqlite3.Error as error:
        raise BackupError(f"a database cannot be copied ({error})") from None
    size_mb = out.stat().st_size / 1e6
    lines = [f"not in the backup, because it lies elsewhere: {path}" for path in outside]
    lines.append(f"{out}: written, {size_mb:.1f} MB; it may hold secrets")
    written = BackedUp(out=str(out), size_mb=size_mb, left_out=list(map(str, outside)))
    return Answer("\n".join(lines), written)


def _write(file: BinaryIO, config: Path, history: Path | None, *, recordings: bool) -> list[Path]:
    beside, outside = _named(config)
    kept: dict[str, KeptFile] = {}
    with ZipFile(file, "w") as archive:
        for path in beside:
            name = f"{CONFIG}/{path.relative_to(config.parent).as_posix()}"
            kept[name] = _add(archive, path, name)
        if history is not None:
            _add_history(archive, history, kept, recordings=recordings)
        manifest = Manifest(
            version=__version__,
            made=datetime.now(UTC).isoformat(timespec="seconds"),
            config=config.name,
            history=None if history is None else str(history.resolve()),
            files=kept,
        )
        archive.writestr(MANIFEST, manifest.model_dump_json())
    return outside


def _named(config: Path) -> tuple[list[Path], list[Path]]:
    """The configuration and the files that it names: those beside it, and those elsewhere."""
    content = tomllib.loads(config.read_text("utf-8"))
    folder = config.parent
    named = {folder / text for text in _texts(content)}
    certificates = content.get("bus", {}).get("certificates")
    if certificates is not None:
        named |= set((folder / certificates).glob("*"))
    named = {path for path in named if _is_file(path)}
    beside = {path for path in named if path.is_relative_to(folder) and ".." not in path.parts}
    return sorted({config, *beside}), sorted(named - beside)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a text that can be no name
        return False


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)


def _add_history(
    archive: ZipFile, folder: Path, kept: dict[str, KeptFile], *, recordings: bool
) -> None:
    """Copy until nothing is new: while it is copied, an hour's log may become other files."""
    seen: set[Path] = set()
    for _ in range(_MOST_PASSES):
        new = [path for path in _history_files(folder, recordings=recordings) if path not in seen]
        seen |= set(new)
        for path in new:
            name = f"{HISTORY}/{path.relative_to(folder).as_posix()}"
            with suppress(FileNotFoundError):
                kept[name] = _add(archive, path, name)
        if not new:
            return
    raise BackupError(f"{folder}: changes faster than it can be copied")


def _history_files(folder: Path, *, recordings: bool) -> list[Path]:
    """Files of a history; databases last, because others must not be newer than the diary."""
    left_out = _LEFT_OUT if recordings else _LEFT_OUT | {_RECORDINGS}
    found = [
        path
        for path in folder.rglob("*")
        if path.relative_to(folder).parts[0] not in left_out
        and not path.name.endswith(_ELSEWHERE)
        and path.is_file()
        and not path.is_symlink()
    ]
    return sorted(found, key=lambda path: (path.suffix == _DATABASE, path))


def _add(archive: ZipFile, path: Path, name: str) -> KeptFile:
    """Copy a file as it is at one moment."""
    with tempfile.TemporaryFile() as copy, path.open("rb") as source:
        if path.suffix == _DATABASE:
            _copy_database(path, copy)
        else:
            shutil.copyfileobj(source, copy)
        state = os.fstat(source.fileno())
        copy.seek(0)
        digest = hashlib.file_digest(copy, "sha256").hexdigest()
        length = copy.tell()
        copy.seek(0)
        with archive.open(name, "w", force_zip64=True) as member:
            shutil.copyfileobj(copy, member)
    return KeptFile(length=length, sha256=digest, mode=state.st_mode & 0o666, **_owners(state))


def _copy_database(path: Path, copy: BinaryIO) -> None:
    """Content of a database now, also while others write to it."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "copy"
        source = f"{path.resolve().as_uri()}?mode=rw"
        with (
            closing(sqlite3.connect(source, uri=True)) as old,
            closing(sqlite3.connect(whole)) as new,
        ):
            old.backup(new)
        with whole.open("rb") as file:
            shutil.copyfileobj(file, copy)


def _owners(state: os.stat_result) -> dict[str, str]:
    owners = {"user": "", "group": ""}
    with suppress(KeyError):
        owners["user"] = pwd.getpwuid(state.st_uid).pw_name
        owners["group"] = grp.getgrgid(state.st_gid).gr_name
    return owners
