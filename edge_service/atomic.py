"""Files that appear whole or not at all, and are on the disk then: the one way to change a file.

Every file has the mode that the umask leaves it, secrets are for their owner alone.
"""

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO, TextIO

PART = ".part"
PRIVATE = 0o600  # mode of files that their owner alone may read
_NO_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EACCES)


@contextmanager
def replaced_file(path: Path, mode: int = 0o666) -> Iterator[TextIO]:
    """A text file that takes `path`'s place on success and leaves no trace on failure. OSError."""
    with replaced_bytes(path, mode) as raw, TextIOWrapper(raw, "utf-8", newline="") as file:
        yield file


@contextmanager
def replaced_bytes(path: Path, mode: int = 0o666) -> Iterator[BinaryIO]:
    """The same for bytes."""
    with _part(path, mode) as handle, os.fdopen(handle, "wb", closefd=False) as file:
        yield file


def write_whole(path: Path, text: str, mode: int = 0o666) -> None:
    """Write a text file, whole or not at all. Raises OSError."""
    with replaced_file(path, mode) as file:
        file.write(text)


def put_in_place(path: Path, place: Path) -> None:
    """Rename a file or folder, in place of one that is there, for good. Raises OSError."""
    path.replace(place)
    sync_folder(place.parent)


def damaged_name(name: str) -> str:
    """Name under which what is found damaged now is kept."""
    return f"{name}.damaged-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"


def new_file(path: Path, mode: int = 0o666) -> BinaryIO:
    """A file that is begun, and that was not there. Raises OSError."""
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode), "wb")


def append(path: Path, text: str) -> None:
    """Add text to a file such as a log, of which the last line may be lost. Raises OSError."""
    with path.open("a", encoding="utf-8") as file:
        file.write(text)


def made_folder(folder: Path, mode: int = 0o777) -> None:
    """Make a folder with those above it, so that they outlive a power failure. OSError."""
    if folder.is_dir():
        return
    made_folder(folder.parent)
    folder.mkdir(mode, exist_ok=True)
    sync_folder(folder.parent)


def sync_file(path: Path) -> None:
    """Put the content of a file that is complete on the disk. Raises OSError."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Put the names in a folder on the disk; file systems that cannot do that are left alone."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise


@contextmanager
def _part(path: Path, mode: int = 0o666) -> Iterator[int]:
    """A descriptor of a new file that takes `path`'s place on success; errors name that one."""
    if path.exists() and not (path.is_file() or path.is_dir()):  # a device, which root replaces
        raise FileExistsError(errno.EEXIST, "is no file that can be replaced", str(path))
    made_folder(path.parent)
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    try:
        handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
        try:
            if os.geteuid() == 0 and path.exists() and not path.parent.stat().st_mode & 0o022:
                old = path.stat()  # what root writes stays its owner's, where others put nothing
                os.fchown(handle, old.st_uid, old.st_gid)
            yield handle
            os.fsync(handle)
        finally:
            os.close(handle)
        part.replace(path)
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError) and error.errno and error.filename in (None, str(part)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    sync_folder(path.parent)
