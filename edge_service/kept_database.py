"""An SQLite file that outlives crashes, full disks and damage.

Every transaction is on the disk when it ends. The whole file is checked when it is opened; a
damaged one is set aside, and a new one begun with what can be saved of it and of a daily copy.
"""

import fcntl
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from .atomic import made_folder, set_aside, sync_file, sync_folder
from .kept_copy import KeptCopy

Rescue = Callable[[sqlite3.Connection, sqlite3.Connection], None]
"""(damaged file or its copy, new file): takes over what is whole; may raise sqlite3.Error."""
_GREATEST = 2**63 - 1
_CORRUPT, _FOREIGN, _FULL = 11, 26, 13
_BUSY_S = 2.0
_WAL_BYTES = 4_000_000


class DatabaseFailedError(Exception):
    """Reason why the file cannot be read or written now; another try may succeed."""


class KeptDatabase:
    """One file, for any thread and for several processes; without a path it lives in memory.

    Args:
        path: of the file; its folder is made.
        schema: statements that make the tables.
        rescue: see there.
    """

    def __init__(self, path: Path | None, schema: str, rescue: Rescue) -> None:
        self._path, self._schema, self._rescue = path, schema, rescue
        self._copy = None if path is None else KeptCopy(path)
        self._lock = threading.RLock()
        self._file: sqlite3.Connection | None = None
        self._inode = 0
        self.damages: list[str] = []
        """Damaged files that were set aside, a line each."""
        self.rescues = 0
        """Number of times that the file itself was begun anew."""

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """A transaction that is on the disk when the context ends. Raises DatabaseFailedError."""
        with self._lock:
            file = self._opened()
            try:
                file.execute("BEGIN IMMEDIATE")
                yield file
                file.execute("COMMIT")
            except BaseException as error:
                self._leave(file, error)
                if isinstance(error, sqlite3.Error | OSError):
                    raise DatabaseFailedError(str(error)) from None
                raise

    def rows(self, statement: str, *parameters: object) -> list[tuple[Any, ...]]:
        """Rows that a statement finds; beyond 64 bits integers are cut. DatabaseFailedError."""
        with self._lock:
            file = self._opened()
            try:
                return file.execute(statement, [_bounded(each) for each in parameters]).fetchall()
            except sqlite3.Error as error:
                self._leave(file, error)
                raise DatabaseFailedError(str(error)) from None

    def copy(self, now_s: float) -> None:
        """Make the copy anew if it is a day old, or not what it was. Raises DatabaseFailedError."""
        if self._copy is None:
            return
        try:
            damage = self._copy.cleared_of_damage()
            if damage:
                self.damages.append(damage)
            if self._copy.is_due(now_s):
                self._copy.make(lambda part: self.rows("VACUUM INTO ?", str(part)))
        except OSError as error:
            raise DatabaseFailedError(f"{self._copy.path.name}: {error.strerror}") from None

    def close(self) -> None:
        """Close the file; safe twice, and the next use opens it again."""
        with self._lock:
            if self._file is not None:
                with suppress(sqlite3.Error):
                    self._file.close()
            self._file = None

    def __del__(self) -> None:
        self.close()

    def _opened(self) -> sqlite3.Connection:
        if self._file is None or self._is_another():
            self.close()
            try:
                self._file = self._open()
            except (sqlite3.Error, OSError) as error:
                raise DatabaseFailedError(str(error)) from None
        return self._file

    def _is_another(self) -> bool:
        """Tell whether the file was replaced or removed meanwhile; in memory it never is."""
        try:
            return self._path is not None and self._path.stat().st_ino != self._inode
        except OSError:
            return True

    def _open(self) -> sqlite3.Connection:
        if self._path is None:
            return _connected(":memory:", self._schema)
        made_folder(self._path.parent)
        with _alone(self._path.with_name(f"{self._path.name}.lock")):
            _finish(self._path)
            copy = KeptCopy(self._path)
            if self._path.exists() or copy.exists():
                self._check(self._path, copy)
            file = _connected(self._path, self._schema)
            self._inode = self._path.stat().st_ino
        return file

    def _check(self, path: Path, copy: KeptCopy) -> None:
        damage = _damage_of(path, self._schema, copy)
        if damage:
            self._begin_anew((path, copy.path), _new_of(path))
            self.rescues += 1
            aside = f", kept as {set_aside(path).name}" if path.exists() else ""
            _finish(path)
            self.damages.append(f"{path}: {damage}{aside}; started over with what could be saved")

    def _begin_anew(self, sources: tuple[Path, ...], new: Path) -> None:
        for part in _parts(new):
            part.unlink(missing_ok=True)
        with closing(_connected(new, self._schema)) as file:
            for source in sources:
                if source.is_file():
                    with suppress(sqlite3.Error), closing(sqlite3.connect(source)) as old:
                        old.text_factory = _text
                        self._rescue(old, file)
            file.execute("PRAGMA journal_mode = DELETE")
        sync_file(new)

    def _leave(self, file: sqlite3.Connection, error: BaseException) -> None:
        """Undo what was begun; after a failure of the file, the next use opens and checks it."""
        with suppress(sqlite3.Error):
            file.execute("ROLLBACK")
        if isinstance(error, sqlite3.Error) and _code(error) != _FULL:
            self.close()


def _connected(path: Path | str, schema: str) -> sqlite3.Connection:
    file = sqlite3.connect(path, _BUSY_S, isolation_level=None, check_same_thread=False)
    file.text_factory = _text
    try:
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = FULL")
        file.execute(f"PRAGMA journal_size_limit = {_WAL_BYTES}")
        file.executescript(schema)
    except BaseException:
        file.close()
        raise
    return file


def _damage_of(path: Path, schema: str, copy: KeptCopy) -> str:
    """Problems of a file; empty if there are none. Raises sqlite3.Error if it cannot be read."""
    if not path.exists():
        return "it is gone"
    if path.is_dir():
        return "it is a folder"
    try:
        with closing(sqlite3.connect(path, _BUSY_S)) as file:
            ((said,),) = file.execute("PRAGMA integrity_check(1)").fetchall()
            if said != "ok":
                return str(said).splitlines()[-1]
            is_new = not _tables(file) and not copy.exists()
            return "" if is_new or _wanted(schema) <= _tables(file) else "its tables are others"
    except sqlite3.DatabaseError as error:
        if _code(error) not in (_CORRUPT, _FOREIGN):
            raise
        return str(error)


def _wanted(schema: str) -> set[str]:
    with closing(sqlite3.connect(":memory:")) as file:
        file.executescript(schema)
        return _tables(file)


def _tables(file: sqlite3.Connection) -> set[str]:
    return {str(sql) for (sql,) in file.execute("SELECT sql FROM sqlite_schema WHERE sql <> ''")}


def _text(content: bytes) -> str:
    """Text, also where damage has made it none: digests find that."""
    return content.decode(errors="replace")


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary result code; 0 if it has none."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _bounded(value: object) -> object:
    """A parameter that SQLite can compare with what it keeps: no kept integer is greater."""
    return min(max(value, -_GREATEST), _GREATEST) if isinstance(value, int) else value


def _parts(path: Path) -> tuple[Path, ...]:
    """All files of one database."""
    return tuple(path.with_name(f"{path.name}{end}") for end in ("", "-wal", "-shm"))


def _new_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def _finish(path: Path) -> None:
    """Put a new file in the place of the one that was set aside, also after a crash in between."""
    if _new_of(path).exists() and not path.exists():
        for part in _parts(path):
            part.unlink(missing_ok=True)  # a log of the old file must not meet the new one
        _new_of(path).replace(path)
        sync_folder(path.parent)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Hold off other processes while a file is checked, and perhaps replaced."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
