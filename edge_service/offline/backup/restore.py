"""`edge-service restore`: what a backup holds, put back whole or not at all."""

import grp
import hashlib
import json
import os
import pwd
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from zipfile import ZIP_STORED, BadZipFile, ZipFile

from pydantic import ValidationError

from ... import __version__
from ...atomic import made_folder, sync_file, sync_folder
from ...command_answer import Answer
from ...nodes.stores.history_store import UNFINISHED, lock_folder
from ..document import Document
from .contents import (
    CONFIG,
    HISTORY,
    LOCK,
    MANIFEST,
    SCHEMA,
    BackupError,
    KeptFile,
    Manifest,
    check_name,
)

_MOST_MANIFEST_BYTES = 100_000_000
_CHUNK_BYTES = 1 << 20
_DAMAGE = (BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error)
_OURS = (LOCK, UNFINISHED, "lost+found")


class Restored(Document):
    """A sentence on each place that was restored."""

    done: list[str]


def restore(
    backup: Path, config: Path | None, history: Path | None, *, force: bool = False
) -> Answer:
    """Put back configuration, history or both.

    Args:
        config: configuration file to write, beside it the files that it names; None: none.
        history: folder to fill, which must be empty or missing; None: none.
        force: replace files of the configuration that differ.

    Raises:
        BackupError, ConfigError: the backup does not fit, or a service is running; nothing changed.
    """
    try:
        with ZipFile(backup) as archive:
            manifest = read_manifest(archive)
            lines = _restored(archive, manifest, config, history, force=force)
    except OSError as error:
        raise BackupError(f"{error.filename or backup}: {error.strerror}") from None
    except BackupError as error:
        raise BackupError(f"{backup}: {error}") from None
    except _DAMAGE as error:
        raise BackupError(f"{backup}: is damaged, or no backup ({error})") from None
    return Answer("\n".join(lines), Restored(done=lines))


def read_manifest(archive: ZipFile) -> Manifest:
    """Read the manifest, and check that the archive holds what it says. Raises BackupError."""
    held = {info.filename: info for info in archive.infolist()}
    described = held.pop(MANIFEST, None)
    if described is None or described.file_size > _MOST_MANIFEST_BYTES:
        raise BackupError("is no backup: it has no manifest")
    if any(info.compress_type != ZIP_STORED for info in (described, *held.values())):
        raise BackupError("is no backup: it is compressed")
    manifest = _understood(archive.read(MANIFEST))
    if len(archive.infolist()) != len(held) + 1 or set(held) != set(manifest.files):
        raise BackupError("is damaged: it does not hold what its manifest says")
    for name, info in held.items():
        check_name(name)
        if info.file_size != manifest.files[name].length:
            raise BackupError(f"is damaged: {name} has another length than its manifest says")
    return manifest


def _understood(content: bytes) -> Manifest:
    described = json.loads(content)
    if isinstance(described, dict) and described.get("format") != SCHEMA:
        form = described.get("format")
        raise BackupError(f"has the format {form!r:.40}, which only a newer version may know")
    try:
        manifest = Manifest.model_validate(described)
    except ValidationError:
        raise BackupError("is damaged: its manifest is none") from None
    if _minor(manifest.version) > _minor(__version__):
        problem = f"was made by version {manifest.version}; install that one, this is {__version__}"
        raise BackupError(problem)
    return manifest


def _minor(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:2])


def _restored(
    archive: ZipFile, manifest: Manifest, config: Path | None, history: Path | None, *, force: bool
) -> list[str]:
    if history is not None and manifest.history is None:
        raise BackupError("holds no history: it was kept in memory")
    told = []
    with ExitStack() as stages:
        if history is not None:
            owner = history.stat() if history.exists() else None
            filled = stages.enter_context(_history_stage(history))
            _unpack(archive, manifest, HISTORY, filled, owner)
        if config is not None:
            stage = stages.enter_context(_config_stage(config.parent))
            _unpack(archive, manifest, CONFIG, stage)
            told += _place_config(stage, config, manifest.config, force=force)
        if history is not None:
            told.append(_place_history(filled, history))
    return told


@contextmanager
def _config_stage(folder: Path) -> Iterator[Path]:
    made_folder(folder)
    with tempfile.TemporaryDirectory(prefix=".restore-", dir=folder) as stage:
        yield Path(stage)


@contextmanager
def _history_stage(folder: Path) -> Iterator[Path]:
    """A folder within a history that is empty and that no service runs on.

    It stays where only a part was put in its place: then no service takes that for a history.
    """
    lock = lock_folder(folder)
    try:
        if not _is_empty(folder):
            raise BackupError(f"{folder} is not empty: move what it holds elsewhere first")
        stage = folder / UNFINISHED
        stage.mkdir()
        try:
            yield stage
        finally:
            if _is_empty(folder):
                shutil.rmtree(stage, ignore_errors=True)
    finally:
        os.close(lock)


def _is_empty(folder: Path) -> bool:
    """Tell whether a folder holds no history."""
    return all(path.name in _OURS for path in folder.iterdir())


def _unpack(
    archive: ZipFile,
    manifest: Manifest,
    room: str,
    stage: Path,
    owner: os.stat_result | None = None,
) -> None:
    """Unpack one part of the archive; its files are the `owner`'s, or whose they were."""
    files = {name: kept for name, kept in manifest.files.items() if name.startswith(f"{room}/")}
    needed = sum(kept.length for kept in files.values())
    if shutil.disk_usage(stage).free < needed:
        raise BackupError(f"needs {needed / 1e6:.0f} MB, which are not free in {stage.parent}")
    for name, kept in files.items():
        path = stage / name.removeprefix(f"{room}/")
        path.parent.mkdir(parents=True, exist_ok=True)
        _unpack_file(archive, name, kept, path)
        sync_file(path)
        path.chmod(kept.mode & 0o666 | 0o400)
        if os.geteuid() == 0:
            ids = _ids(kept) if owner is None else (owner.st_uid, owner.st_gid)
            for each in (path, *path.parents[: len(path.relative_to(stage).parts)]):
                os.chown(each, *ids)


def _unpack_file(archive: ZipFile, name: str, kept: KeptFile, path: Path) -> None:
    """Write one file of the length that was stated, and compare it with its digest."""
    digest, left = hashlib.sha256(), kept.length
    with archive.open(name) as source, path.open("xb") as file:
        while left and (content := source.read(min(left, _CHUNK_BYTES))):
            digest.update(content)
            file.write(content)
            left -= len(content)
    if left or digest.hexdigest() != kept.sha256:
        raise BackupError(f"is damaged: {name} is not what was backed up")


def _ids(kept: KeptFile) -> tuple[int, int]:
    """Numbers of the owners on this machine; -1 changes nothing, for those that are not known."""
    user = group = -1
    with suppress(KeyError):
        user = pwd.getpwnam(kept.user).pw_uid
        group = grp.getgrnam(kept.group).gr_gid
    return user, group


def _place_config(stage: Path, config: Path, name: str, *, force: bool) -> list[str]:
    """Move the files of a configuration to their places."""
    places = {
        path: config if path == stage / name else config.parent / path.relative_to(stage)
        for path in sorted(stage.rglob("*"))
        if path.is_file()
    }
    for path, place in places.items():
        if not force and place.exists() and place.read_bytes() != path.read_bytes():
            raise BackupError(f"{place} is there already, and differs; --force replaces it")
    for path, place in places.items():
        made_folder(place.parent)
        path.replace(place)
        sync_folder(place.parent)
    return [f"{place}: restored" for place in places.values()]


def _place_history(stage: Path, folder: Path) -> str:
    """Move what was unpacked to its place; a folder that was made for it gets its owner."""
    owner = stage.stat()
    for path in sorted(stage.iterdir()):
        path.replace(folder / path.name)
    if os.geteuid() == 0:
        for each in (folder, folder / LOCK):
            os.chown(each, owner.st_uid, owner.st_gid)
    stage.rmdir()
    sync_folder(folder)
    return f"{folder}: restored"
