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
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Literal
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from pydantic import ValidationError

from .. import __version__
from ..atomic import PRIVATE, made_folder, new_file, put_in_place, replaced_bytes, sync_file
from ..command_answer import Answer
from ..config import load_config, state_folder
from ..exit_status import BadInputError
from ..health.store.store import FILE_NAME, LOCK, Store, StoreFailedError, held, is_in_use
from ..messages.interval import Frozen

MANIFEST = "manifest.json"
CONFIG, STATE = "config", "state"
SCHEMA: Literal["backup/3"] = "backup/3"
_MOST_MANIFEST_BYTES = 100_000_000
_CHUNK_BYTES = 1 << 20
_DAMAGE = (BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error)


class BackupError(BadInputError):
    """Reason why nothing was backed up or restored; the text is one line."""


class Manifest(Frozen):
    """Description of a backup."""

    format: Literal["backup/3"] = SCHEMA
    version: str  # of the service that made it
    made: str  # time, UTC, ISO 8601
    config: str  # name of the configuration file
    # name in the archive, `config/...` or `state/...` -> SHA-256 in hexadecimal
    files: dict[str, str]


def back_up(config: Path, out: Path, *, recordings: bool = False) -> Answer:
    """Write a backup of a service, which may be running. Raises ConfigError, BackupError."""
    folder, place = load_config(config).store.folder, config.parent
    named = set()
    for text in _texts(tomllib.loads(config.read_text("utf-8-sig"))):
        with suppress(OSError, ValueError):  # a text that can be no name
            if (place / text).is_file():
                named.add(place / text)
    beside = {path for path in named if path.is_relative_to(place) and ".." not in path.parts}
    outside = sorted(named - beside)
    files = {f"{CONFIG}/{path.relative_to(place).as_posix()}": path for path in {config, *beside}}
    try:
        with replaced_bytes(out, PRIVATE) as file, ExitStack() as stack:
            if folder is not None:
                for name in ("axes", "recordings") if recordings else ("axes",):
                    for path in (folder / name).rglob("*"):
                        if path.is_file() and not path.is_symlink():
                            files[f"{STATE}/{path.relative_to(folder).as_posix()}"] = path
            if folder is not None and (folder / FILE_NAME).exists():
                copies = stack.enter_context(tempfile.TemporaryDirectory(dir=out.parent))
                copy = files[f"{STATE}/{FILE_NAME}"] = Path(copies) / FILE_NAME
                with closing(Store(folder / FILE_NAME, mends=False)) as store:
                    store.copy_to(copy)
                copy.chmod((folder / FILE_NAME).stat().st_mode & 0o777)
            archive = stack.enter_context(ZipFile(file, "w"))
            kept = {name: _added(archive, name, files[name]) for name in sorted(files)}
            made = datetime.now(UTC).isoformat(timespec="seconds")
            manifest = Manifest(version=__version__, made=made, config=config.name, files=kept)
            archive.writestr(MANIFEST, manifest.model_dump_json())
    except OSError as error:
        raise BackupError(f"{error.filename or out}: {error.strerror}") from None
    except StoreFailedError as error:
        raise BackupError(str(error)) from None
    size_mb = out.stat().st_size / 1e6
    lines = [f"not in the backup, because it lies elsewhere: {path}" for path in outside]
    lines.append(f"{out}: written, {size_mb:.1f} MB; it may hold secrets")
    document = {"out": str(out), "size_mb": size_mb, "left_out": list(map(str, outside))}
    return Answer("\n".join(lines), document)


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def _added(archive: ZipFile, name: str, path: Path) -> str:
    digest, info = hashlib.sha256(), ZipInfo(name)
    info.external_attr = (path.stat().st_mode & 0o666) << 16
    with path.open("rb") as source, archive.open(info, "w", force_zip64=True) as member:
        while content := source.read(_CHUNK_BYTES):
            digest.update(content)
            member.write(content)
    return digest.hexdigest()


def restore(backup: Path, config: Path, *, force: bool = False) -> Answer:
    """Put a backup back, whole or not at all: the store where that configuration keeps it.

    What is replaced stays beside it, as `NAME.before-TIME`.

    Raises BackupError: the backup does not fit, or a service is running; nothing changed.
    """
    try:
        with ZipFile(backup) as archive, ExitStack() as stages:
            place = Path(os.path.normpath(config.absolute()))
            lines = _restored(archive, place, stages, force=force)
    except OSError as error:
        raise BackupError(f"{error.filename or backup}: {error.strerror}") from None
    except BackupError as error:
        raise BackupError(f"{backup}: {error}") from None
    except _DAMAGE as error:
        raise BackupError(f"{backup}: is damaged, or no backup ({error})") from None
    return Answer("\n".join(lines), {"done": lines})


def _manifest_of(archive: ZipFile) -> Manifest:
    """Manifest of an archive that holds what it says, under names that stay in their place."""
    held = archive.infolist()
    if MANIFEST not in archive.namelist():
        raise BackupError("is no backup: it has no manifest")
    if any(info.compress_type != ZIP_STORED for info in held):
        raise BackupError("is no backup: it is compressed")
    if archive.getinfo(MANIFEST).file_size > _MOST_MANIFEST_BYTES:
        raise BackupError("is damaged: its manifest is none")
    document = json.loads(archive.read(MANIFEST))
    if isinstance(document, dict) and document.get("format") != SCHEMA:
        form = document.get("format")
        raise BackupError(f"has the format {form!r:.40}, which only another version may know")
    try:
        manifest = Manifest.model_validate(document)
    except ValidationError:
        raise BackupError("is damaged: its manifest is none") from None
    made, own = (
        tuple(int(part) for part in version.split(".")[:2])
        for version in (manifest.version, __version__)
    )
    if made > own:
        problem = f"was made by version {manifest.version}; install that one, this is {__version__}"
        raise BackupError(problem)
    names = {*manifest.files, f"{CONFIG}/{manifest.config}", MANIFEST}
    if sorted(names) != sorted(archive.namelist()):
        raise BackupError("is damaged: it does not hold what its manifest says")
    if f"{CONFIG}/{manifest.config}" not in manifest.files:
        raise BackupError("is damaged: its manifest does not name the configuration")
    for name in manifest.files:
        parts = name.split("/")
        is_plain = len(parts) > 1 and str(PurePosixPath(name)) == name and ".." not in parts
        if not (is_plain and parts[0] in (CONFIG, STATE) and name.isprintable()):
            raise BackupError(f"{name!r:.80} is no name of a file of a backup")
    return manifest


def _restored(archive: ZipFile, config: Path, stages: ExitStack, *, force: bool) -> list[str]:
    """Unpack beside the places, check all, then put each folder in place by one rename."""
    manifest, place = _manifest_of(archive), config.parent
    written = _unpacked(archive, manifest, CONFIG, _stage(place, stages), place)
    put_in_place(written / manifest.config, written / config.name)
    table = tomllib.loads((written / config.name).read_text("utf-8-sig")).get("store", {})
    named = table.get("folder") if isinstance(table, dict) else None
    folder = state_folder(Path(named) if isinstance(named, str) else None, place)
    places, lines = [(written, place)], [f"{config}: restored"]
    if folder is None:
        lines.append("the history is left out: this configuration keeps it in memory only")
    elif not any(name.startswith(f"{STATE}/") for name in manifest.files):
        folder = None
    else:
        folder = Path(os.path.normpath(folder))
        lines.append(f"{folder}: restored")
    for there in place.rglob("*") if place.exists() else ():
        if there.is_dir() or (folder is not None and there.is_relative_to(folder)):
            continue
        path = written / there.relative_to(place)
        if not path.is_file():
            raise BackupError(f"{there} is no part of the backup; restore to a folder of its own")
        if not force and there.read_bytes() != path.read_bytes():
            raise BackupError(f"{there} is there already, and differs; --force replaces it")
    if folder is not None:
        if not force and folder.exists() and any(folder.iterdir()):
            raise BackupError(f"{folder} is not empty; --force keeps it beside the restored one")
        if (folder / LOCK).exists():  # nobody may begin on it now
            stages.enter_context(held(folder))
        if is_in_use(folder / FILE_NAME):
            raise BackupError(f"{folder / FILE_NAME} is in use: stop the service first")
        is_inside = folder.is_relative_to(place)
        _check_mount(folder)
        stage = written / folder.relative_to(place) if is_inside else _stage(folder, stages)
        _unpacked(archive, manifest, STATE, stage, folder)
        places = places if is_inside else [(stage, folder), *places]
    _all_in_place(places)
    return lines


def _stage(place: Path, stages: ExitStack) -> Path:
    """Folder to fill beside a place, gone at the end unless it has taken that."""
    _check_mount(place)
    made_folder(place.parent)
    around = tempfile.TemporaryDirectory(prefix=".restore-", dir=place.parent)
    return Path(stages.enter_context(around)) / place.name


def _check_mount(place: Path) -> None:
    if place.is_mount():
        raise BackupError(f"{place} is a mount point, which no rename replaces; use a folder in it")


def _unpacked(archive: ZipFile, manifest: Manifest, room: str, stage: Path, place: Path) -> Path:
    """Folder `stage`, to be put in a place, with one part of the archive: every byte is checked."""
    stage.mkdir(0o750, parents=True)
    for name, sha256 in manifest.files.items():
        if not name.startswith(f"{room}/"):
            continue
        path, digest = stage / name.removeprefix(f"{room}/"), hashlib.sha256()
        path.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(name) as source, new_file(path) as file:
            while content := source.read(_CHUNK_BYTES):
                digest.update(content)
                file.write(content)
        if digest.hexdigest() != sha256:
            raise BackupError(f"is damaged: {name} is not what was backed up")
        path.chmod(archive.getinfo(name).external_attr >> 16 & 0o666 | 0o400)
        sync_file(path)
    there = next(each for each in (place, *place.parents) if each.exists())
    if there == place:
        shutil.copymode(place, stage)
    if os.geteuid() == 0:
        owner = there.stat()
        for path in (stage, *stage.rglob("*")):
            os.chown(path, owner.st_uid, owner.st_gid)
    return stage


def _all_in_place(places: list[tuple[Path, Path]]) -> None:
    """Rename folders into their places, what was there to `NAME.before-TIME`; all or none."""
    now = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    done: list[tuple[Path, Path]] = []
    try:
        for stage, place in places:
            if place.exists() and any(place.iterdir()):
                aside = place.with_name(f"{place.name}.before-{now}")
                put_in_place(place, aside)
                done.append((place, aside))
            put_in_place(stage, place)
            done.append((stage, place))
    except OSError:
        for before, after in reversed(done):
            put_in_place(after, before)
        raise
