"""`edge-service backup` and `restore`: configuration and store in one file, and back from it.

A backup is a ZIP archive without compression: `config/`, `state/`, and a manifest that it must fit.
"""

import hashlib
import json
import os
import shutil
import tempfile
import tomllib
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Literal
from zipfile import ZIP_STORED, BadZipFile, ZipFile

from pydantic import ValidationError

from .. import __version__
from ..atomic import (
    PRIVATE,
    made_folder,
    new_file,
    put_in_place,
    replaced_bytes,
    sync_file,
)
from ..command_answer import Answer
from ..config import load_config, state_folder
from ..health.store.store import FILE_NAME, Store, StoreFailedError, is_in_use
from ..messages.estimate import Frozen
from .document import Document

MANIFEST = "manifest.json"
CONFIG, STATE = "config", "state"
SCHEMA: Literal["backup/2"] = "backup/2"
_MOST_MANIFEST_BYTES = 100_000_000
_MOST_FILES_BESIDE = 1000
_CHUNK_BYTES = 1 << 20
_DAMAGE = (BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error)


class BackupError(Exception):
    """Reason why nothing was backed up or restored; the text is one line."""


class KeptFile(Frozen):
    """Length in bytes, SHA-256 in hexadecimal and permissions of one file of a backup."""

    length: int
    sha256: str
    mode: int


class Manifest(Frozen):
    """Description of a backup.

    Attributes:
        version: of the service that made it.
        made: time, UTC, ISO 8601.
        config: name of the configuration file.
        files: by name in the archive, `config/...` and `state/...`.
    """

    format: Literal["backup/2"] = SCHEMA
    version: str
    made: str
    config: str
    files: dict[str, KeptFile]


class BackedUp(Document):
    """A backup; files that the configuration names and that lie elsewhere are left out."""

    out: str
    size_mb: float
    left_out: list[str]


class Restored(Document):
    """A sentence on each place that was restored."""

    done: list[str]


def back_up(config: Path, out: Path, *, recordings: bool = False) -> Answer:
    """Write a backup of the service with this configuration; it may be running.

    Raises:
        ConfigError: the configuration is wrong.
        BackupError: something cannot be read or written; then nothing was.
    """
    folder = load_config(config).store.folder
    beside, outside = _named(config)
    files = {f"{CONFIG}/{path.relative_to(config.parent).as_posix()}": path for path in beside}
    try:
        with replaced_bytes(out, PRIVATE) as file, ExitStack() as stack:
            if folder is not None:
                copies = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=out.parent)))
                files |= _state_files(folder, copies / FILE_NAME, recordings=recordings)
            _write(file, config.name, files)
    except (OSError, StoreFailedError) as error:
        raise BackupError(_said(error, out)) from None
    size_mb = out.stat().st_size / 1e6
    lines = [f"not in the backup, because it lies elsewhere: {path}" for path in outside]
    lines.append(f"{out}: written, {size_mb:.1f} MB; it may hold secrets")
    written = BackedUp(out=str(out), size_mb=size_mb, left_out=list(map(str, outside)))
    return Answer("\n".join(lines), written)


def restore(backup: Path, config: Path, *, force: bool = False) -> Answer:
    """Put a backup back, whole or not at all: the store where that configuration keeps it.

    What is replaced stays beside it, as `NAME.before-TIME`.

    Args:
        config: configuration file to write, beside it the files that it names.
        force: replace files of the configuration that differ, and a store that is there.

    Raises:
        BackupError: the backup does not fit, or a service is running; nothing changed.
    """
    try:
        with ZipFile(backup) as archive, ExitStack() as stages:
            manifest = read_manifest(archive)
            lines = _restored(archive, manifest, config.absolute(), stages, force=force)
    except shutil.Error as error:
        raise BackupError(f"{config.parent}: cannot be kept beside it ({error})") from None
    except OSError as error:
        raise BackupError(_said(error, backup)) from None
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
    document = json.loads(archive.read(MANIFEST))
    if isinstance(document, dict) and document.get("format") != SCHEMA:
        form = document.get("format")
        raise BackupError(f"has the format {form!r:.40}, which only another version may know")
    try:
        manifest = Manifest.model_validate(document)
    except ValidationError:
        raise BackupError("is damaged: its manifest is none") from None
    if _minor(manifest.version) > _minor(__version__):
        problem = f"was made by version {manifest.version}; install that one, this is {__version__}"
        raise BackupError(problem)
    names = {*manifest.files, f"{CONFIG}/{manifest.config}"}
    if len(archive.infolist()) != len(held) + 1 or set(held) != names:
        raise BackupError("is damaged: it does not hold what its manifest says")
    for name, info in held.items():
        parts = name.split("/")
        is_plain = len(parts) > 1 and str(PurePosixPath(name)) == name and ".." not in parts
        if not (is_plain and parts[0] in (CONFIG, STATE) and name.isprintable()):
            raise BackupError(f"{name!r:.80} is no name of a file of a backup")
        if info.file_size != manifest.files[name].length:
            raise BackupError(f"is damaged: {name} has another length than its manifest says")
    return manifest


def _minor(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:2])


def _said(error: OSError | StoreFailedError, path: Path) -> str:
    if isinstance(error, OSError):
        return f"{error.filename or path}: {error.strerror}"
    return str(error)


def _named(config: Path) -> tuple[list[Path], list[Path]]:
    """The configuration and the files that it names: those beside it, and those elsewhere."""
    folder = config.parent
    named = set()
    for text in _texts(tomllib.loads(config.read_text("utf-8"))):
        with suppress(OSError, ValueError):  # a text that can be no name
            if (folder / text).is_file():
                named.add(folder / text)
    beside = {path for path in named if path.is_relative_to(folder) and ".." not in path.parts}
    return sorted({config, *beside}), sorted(named - beside)


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def _state_files(folder: Path, copy: Path, *, recordings: bool) -> dict[str, Path]:
    """Files of the state by their names in the archive, with a copy of the store as it is now."""
    files = {}
    if (folder / FILE_NAME).exists():
        with closing(Store(folder / FILE_NAME, mends=False)) as store:
            store.copy_to(copy)
        copy.chmod((folder / FILE_NAME).stat().st_mode & 0o777)
        files[f"{STATE}/{FILE_NAME}"] = copy
    for part in ("axes", "recordings") if recordings else ("axes",):
        for path in sorted((folder / part).rglob("*")):
            if path.is_file() and not path.is_symlink():
                files[f"{STATE}/{path.relative_to(folder).as_posix()}"] = path
    return files


def _write(file: BinaryIO, config: str, files: dict[str, Path]) -> None:
    kept = {}
    with ZipFile(file, "w") as archive:
        for name, path in files.items():
            digest, length = hashlib.sha256(), 0
            with path.open("rb") as source, archive.open(name, "w", force_zip64=True) as member:
                while content := source.read(_CHUNK_BYTES):
                    digest.update(content)
                    length += len(content)
                    member.write(content)
            mode = path.stat().st_mode & 0o666
            kept[name] = KeptFile(length=length, sha256=digest.hexdigest(), mode=mode)
        made = datetime.now(UTC).isoformat(timespec="seconds")
        manifest = Manifest(version=__version__, made=made, config=config, files=kept)
        archive.writestr(MANIFEST, manifest.model_dump_json())


def _restored(
    archive: ZipFile, manifest: Manifest, config: Path, stages: ExitStack, *, force: bool
) -> list[str]:
    """Unpack beside the places, check all, then put each folder in place by one rename."""
    place = config.parent
    written = _unpacked(archive, manifest, CONFIG, _stage(place, stages), place)
    put_in_place(written / manifest.config, written / config.name)
    _check_config(written, place, force=force)
    places, lines = [(written, place)], [f"{config}: restored"]
    folder = _state_folder(written / config.name, place)
    if not any(name.startswith(f"{STATE}/") for name in manifest.files):
        folder = None
    elif folder is None:
        lines.append("the history is left out: this configuration keeps it in memory only")
    else:
        _check_state(folder, force=force)
        is_inside = folder.is_relative_to(place)
        stage = written / folder.relative_to(place) if is_inside else _stage(folder, stages)
        _unpacked(archive, manifest, STATE, stage, folder)
        places = [*([] if is_inside else [(stage, folder)]), *places]
        lines.append(f"{folder}: restored")
    _keep_others(place, written, folder)
    undos: list[Callable[[], None]] = []
    try:
        for stage, place in places:
            undos.append(_swapped(stage, place))
    except OSError:
        for undo in reversed(undos):
            undo()
        raise
    return lines


def _state_folder(config: Path, folder: Path) -> Path | None:
    """State folder of a configuration that will lie in `folder`; None: it keeps nothing."""
    table = tomllib.loads(config.read_text("utf-8")).get("store", {})
    named = table.get("folder") if isinstance(table, dict) else None
    found = state_folder(Path(named) if isinstance(named, str) else None, folder)
    return None if found is None else Path(os.path.normpath(found))


def _check_config(stage: Path, folder: Path, *, force: bool) -> None:
    """Refuse to replace what differs, unless it is wanted. Raises BackupError."""
    for path in sorted(stage.rglob("*")):
        place = folder / path.relative_to(stage)
        if force or not path.is_file() or not os.path.lexists(place):
            continue
        if not place.is_file() or place.read_bytes() != path.read_bytes():
            raise BackupError(f"{place} is there already, and differs; --force replaces it")


def _check_state(folder: Path, *, force: bool) -> None:
    """Refuse a store that is there already, and one that a service uses. Raises BackupError."""
    if not force and folder.exists() and any(folder.iterdir()):
        raise BackupError(f"{folder} is not empty; --force keeps it beside the restored one")
    path = folder / FILE_NAME
    if path.exists() and is_in_use(path):
        raise BackupError(f"{path} is in use: stop the service first")


def _stage(place: Path, stages: ExitStack) -> Path:
    """Folder to fill beside a place, gone at the end unless it has taken that."""
    made_folder(place.parent)
    around = tempfile.TemporaryDirectory(prefix=".restore-", dir=place.parent)
    return Path(stages.enter_context(around)) / place.name


def _unpacked(archive: ZipFile, manifest: Manifest, room: str, stage: Path, place: Path) -> Path:
    """Folder `stage`, to be put in a place, with one part of the archive: every byte is checked."""
    files = {name: kept for name, kept in manifest.files.items() if name.startswith(f"{room}/")}
    needed, there = sum(kept.length for kept in files.values()), place
    while not there.exists():
        there = there.parent
    if shutil.disk_usage(there).free < needed:
        raise BackupError(f"needs {needed / 1e6:.0f} MB, which are not free in {there}")
    stage.mkdir(0o750, parents=True)
    for name, kept in files.items():
        path = stage / name.removeprefix(f"{room}/")
        path.parent.mkdir(parents=True, exist_ok=True)
        digest, left = hashlib.sha256(), kept.length
        with archive.open(name) as source, new_file(path) as file:
            while left and (content := source.read(min(left, _CHUNK_BYTES))):
                digest.update(content)
                file.write(content)
                left -= len(content)
        if left or digest.hexdigest() != kept.sha256:
            raise BackupError(f"is damaged: {name} is not what was backed up")
        path.chmod(kept.mode & 0o666 | 0o400)
        sync_file(path)
    if place.exists():
        shutil.copymode(place, stage)
    if os.geteuid() == 0:
        owner = there.stat()
        for path in (stage, *stage.rglob("*")):
            os.chown(path, owner.st_uid, owner.st_gid)
    return stage


def _keep_others(folder: Path, stage: Path, state: Path | None) -> None:
    """Let the other files beside a configuration, but no state, stand in its new folder as well."""
    if not folder.exists():
        return
    beside = (each for each in folder.rglob("*") if state is None or state not in each.parents)
    if sum(1 for _ in islice(beside, _MOST_FILES_BESIDE + 1)) > _MOST_FILES_BESIDE:
        raise BackupError(f"{folder} holds much beside a configuration; use a folder of its own")

    def ignored(path: str, names: list[str]) -> list[str]:
        found = [name for name in names if name.startswith(".restore-")]
        return [*found, *(name for name in names if Path(path, name) == state)]

    def link(source: str, target: str) -> None:
        if not os.path.lexists(target):
            os.link(source, target, follow_symlinks=False)

    shutil.copytree(
        folder, stage, symlinks=True, ignore=ignored, copy_function=link, dirs_exist_ok=True
    )


def _swapped(stage: Path, place: Path) -> Callable[[], None]:
    """Put a folder in its place; what was there stays beside it. Returns what undoes that."""
    aside = place.with_name(f"{place.name}.before-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
    was_there = place.exists() and any(place.iterdir())
    if was_there:
        put_in_place(place, aside)
    try:
        put_in_place(stage, place)
    except OSError:
        if was_there:
            put_in_place(aside, place)
        raise

    def undo() -> None:
        put_in_place(place, stage)
        if was_there:
            put_in_place(aside, place)

    return undo
