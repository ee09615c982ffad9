"""States that outlive the process: one row for each name and axis."""

import fcntl
import json
import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from zlib import crc32

from ...atomic import damaged_name, made_folder, new_file, put_in_place, sync_file
from ...exit_status import BadInputError
from ...threads import Threads

T = TypeVar("T")
Given = ParamSpec("Given")
FILE_NAME, LOCK = "edge-service.sqlite", ".lock"
APPLICATION_ID = 0x65645376
"""Mark in the header of the file."""
_CORRUPT, _NO_ACCESS, _FOREIGN = 11, 14, 26
_BUSY_S = 2.0
_WAL_BYTES = 4_000_000
_FAILED = (sqlite3.Error, UnicodeDecodeError)
"""Errors of reading a file; Python cannot decode SQLite's own words on a damaged name."""
_FILE_MODE, _FOLDER_MODE = 0o640, 0o750


class StoreFailedError(Exception):
    """Reason why the file cannot be read or written now; another try may succeed."""


class Store:
    """The file, for any thread and for several processes.

    Args:
        path: of the file; its folder is made. None: the store lives in memory.
        mends: False: a file that is damaged, missing or of others is refused, and left as it is.

    Attributes:
        damages: what was found damaged: files that were set aside, rows, a line each.
        is_new_file: a file that was damaged or gone has been begun anew: rows may be lost.
        problem: reason for which nothing can be kept now; empty if it can.
    """

    def __init__(self, path: Path | None, *, mends: bool = True) -> None:
        self.path = path
        self._mends = mends
        self.damages: list[str] = []
        self.is_new_file = False
        self.problem = ""
        self._name = "the store" if path is None else str(path)
        self._threads = Threads("store", 2)
        self._schemas: list[str] = []
        self._lock = threading.RLock()
        self._writer: sqlite3.Connection | None = None
        self._check = "quick_check"
        self._device = self._inode = -1

    def define(self, schema: str) -> None:
        """Add statements that make the tables of one owner; they run before the next use."""
        with self._lock:
            if schema not in self._schemas:
                self._schemas.append(schema)
                if self._writer is not None and self.path is None:
                    self._writer.executescript(schema)
                else:
                    self.close()

    def write(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Result of work in one transaction, on the disk when it returns. Raises StoreFailedError.

        An error of the work itself undoes it and is raised as it is.
        """
        with self._lock:
            file = self._open_writer()
            try:
                file.execute("BEGIN IMMEDIATE")
                result = work(file)
                file.execute("COMMIT")
            except _FAILED as error:
                raise self._translated(error) from None
            finally:
                if file.in_transaction:
                    with suppress(sqlite3.Error):
                        file.execute("ROLLBACK")
            self.problem = ""
            return result

    def read(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Result of work that sees one state of the file. Raises StoreFailedError."""
        if self.path is None:
            with self._lock:
                return work(self._open_writer())
        if self._writer is None or self._check or self._is_another():
            with self._lock:
                self._open_writer()
        try:
            with closing(_connected(self.path)) as file:
                file.execute("PRAGMA query_only = ON")
                file.execute("BEGIN")
                return work(file)
        except _FAILED as error:
            raise self._translated(error) from None

    async def run(self, work: Callable[Given, T], *args: Given.args, **kwargs: Given.kwargs) -> T:
        """Result of work in a thread of the store: a disk that hangs holds up nothing else."""
        return await self._threads.run(work, *args, **kwargs)

    def copy_to(self, path: Path) -> None:
        """Write a copy of the file as it is now. Raises StoreFailedError."""
        with self._lock:
            try:
                self._open_writer().execute("VACUUM INTO ?", (str(path),))
            except _FAILED as error:
                raise self._translated(error) from None

    def close(self) -> None:
        """Close the file; safe twice, and the next use opens it again."""
        with self._lock:
            if self._writer is not None and self.path is not None:
                with suppress(sqlite3.Error):
                    self._writer.close()
                self._writer = None

    def __del__(self) -> None:
        self.close()

    def _translated(self, error: Exception) -> Exception:
        """StoreFailedError where the file failed; an error of the work as it is."""
        if isinstance(error, OSError):
            reason = f"{error.filename or self._name}: {error.strerror}"
        elif isinstance(error, UnicodeDecodeError):
            reason = f"{self._name}: damaged text"
            self._check = "integrity_check"
        elif type(error) in (sqlite3.DatabaseError, sqlite3.OperationalError):
            reason = f"{self._name}: {error}"
            if _code(error) in (_CORRUPT, _FOREIGN):
                self._check = "integrity_check"
        else:
            return error
        self.problem = reason
        return StoreFailedError(reason)

    def _open_writer(self) -> sqlite3.Connection:
        try:
            if self._writer is not None and (self._check or self._is_another()):
                self.close()
            if self._writer is None:
                self._writer = self._open()
        except (*_FAILED, OSError) as error:
            raise self._translated(error) from None
        return self._writer

    def _is_another(self) -> bool:
        """Return whether the file was replaced or removed meanwhile; in memory it never is."""
        try:
            return self.path is not None and self.path.stat().st_ino != self._inode
        except OSError:
            return True

    def _open(self) -> sqlite3.Connection:
        if self.path is None:
            file = _connected(":memory:")
        else:
            self._make_folder(self.path.parent)
            with _locked(self.path.parent, fcntl.LOCK_EX):
                self._make_whole(self.path)
                file = _connected(self.path)
                self._inode = self.path.stat().st_ino
        try:
            for schema in self._schemas:
                file.executescript(schema)
        except BaseException:
            file.close()
            raise
        self._check = ""
        return file

    def _make_folder(self, folder: Path) -> None:
        """Make the folder, unless the disk that it was on is away. Raises OSError."""
        there = folder
        while not os.path.lexists(there):
            there = there.parent
        device = there.stat().st_dev
        if self._device not in (-1, device):
            raise OSError(0, "its disk is away", str(folder))
        made_folder(folder, _FOLDER_MODE)
        self._device = device

    def _make_whole(self, path: Path) -> None:
        """Set a damaged file aside, and begin a new one where there is none."""
        _finish(path)
        was_known = self._inode != -1 or path.with_name(f"{path.name}-wal").exists()
        if path.exists():
            damage = _damage_of(path, self._check or "quick_check")
        elif was_known:
            damage = "it is gone"
        else:
            damage = ""
        if damage or not path.exists():
            if not self._mends:
                raise OSError(0, damage or "there is no such file", str(path))
            self._begin_anew(path)
            if damage:
                self.is_new_file = True
                aside = path.with_name(damaged_name(path.name))
                if path.exists():
                    put_in_place(path, aside)
                    damage += f", kept as {aside.name}"
                self.damages.append(f"{path}: {damage}; begun anew with what can be read")
            _finish(path)

    def _begin_anew(self, path: Path) -> None:
        """Write a new file beside the old one, with what can be read of that."""
        new = path.with_name(f".{path.name}.part")
        for part in _parts(new):
            part.unlink(missing_ok=True)
        new_file(new, _FILE_MODE).close()
        if os.geteuid() == 0:
            owner = path.parent.stat()
            os.chown(new, owner.st_uid, owner.st_gid)
        with closing(sqlite3.connect(new, isolation_level=None)) as file:
            file.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            for schema in self._schemas:
                file.executescript(schema)
            if path.is_file():
                with suppress(*_FAILED), closing(sqlite3.connect(path)) as old:
                    old.text_factory = _text
                    _rescue(old, file)
        sync_file(new)
        put_in_place(new, _new_of(path))


def is_in_use(path: Path) -> bool:
    """Return whether another process has a store open. Raises OSError."""
    if not path.exists():
        return False
    try:
        with closing(sqlite3.connect(path, 0.1)) as file:
            file.execute("PRAGMA journal_mode = DELETE")  # for whoever has it alone
    except sqlite3.OperationalError:
        return True
    except sqlite3.DatabaseError:
        pass  # damaged: nobody can use it
    return False


def _rescue(old: sqlite3.Connection, new: sqlite3.Connection) -> None:
    """Copy the rows of every table, from both ends up to what cannot be read."""
    tables = "SELECT name, sql FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'"
    for name, statement in old.execute(tables).fetchall():
        with suppress(*_FAILED):
            new.execute(statement)
        quoted = '"' + name.replace('"', '""') + '"'
        for order in ("ASC", "DESC"):
            with suppress(*_FAILED):
                rows = old.execute(f"SELECT * FROM {quoted} ORDER BY 1 {order}")
                marks = ", ".join("?" * len(rows.description))
                new.execute("BEGIN")
                try:
                    new.executemany(f"INSERT OR IGNORE INTO {quoted} VALUES ({marks})", rows)
                finally:
                    new.execute("COMMIT")


def _connected(path: Path | str) -> sqlite3.Connection:
    file = sqlite3.connect(path, _BUSY_S, isolation_level=None, check_same_thread=False)
    file.text_factory = _text
    try:
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = FULL")
        file.execute(f"PRAGMA journal_size_limit = {_WAL_BYTES}")
    except BaseException:
        file.close()
        raise
    return file


def _damage_of(path: Path, check: str) -> str:
    """Damage of a file; empty if there is none. Raises sqlite3.Error, OSError: unreadable now."""
    try:
        with closing(sqlite3.connect(path, _BUSY_S)) as file:
            file.text_factory = _text
            ((mark,),) = file.execute("PRAGMA application_id").fetchall()
            if mark != APPLICATION_ID:
                return "it is no store of this service"
            ((said,),) = file.execute(f"PRAGMA {check}(1)").fetchall()
            return "" if said == "ok" else str(said).splitlines()[-1]
    except UnicodeDecodeError:
        return "a name in it is no text"
    except sqlite3.DatabaseError as error:
        if _code(error) == _NO_ACCESS:
            path.open("rb").close()  # says why
        if _code(error) not in (_CORRUPT, _FOREIGN):
            raise
        return str(error)


def _text(content: bytes) -> str:
    """Text, also where damage has made it none: the check of the row finds that."""
    return content.decode(errors="replace")


def _code(error: BaseException) -> int:
    """SQLite's primary result code; 0 if there is none."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def _parts(path: Path) -> tuple[Path, ...]:
    return tuple(path.with_name(f"{path.name}{end}") for end in ("", "-wal", "-shm"))


def _new_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


def _finish(path: Path) -> None:
    """Put a new file into the place of one that was set aside, also after a crash in between."""
    if _new_of(path).exists() and not path.exists():
        for part in _parts(path):
            part.unlink(missing_ok=True)  # a log of the old file must not meet the new one
        put_in_place(_new_of(path), path)


@contextmanager
def _locked(path: Path, kind: int, flags: int = 0) -> Iterator[None]:
    """Hold off other processes, such as while the file is checked, and perhaps replaced."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | flags, _FILE_MODE)
    try:
        fcntl.flock(handle, kind)
        yield
    finally:
        os.close(handle)


@contextmanager
def held(folder: Path | None, *, alone: bool = True) -> Iterator[None]:
    """Hold a state folder for one service, or its nodes. Raises BadInputError: another has it."""
    kind = (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB
    with ExitStack() as stack:
        if folder is not None:
            try:
                made_folder(folder, _FOLDER_MODE)
                stack.enter_context(_locked(folder / LOCK, kind, os.O_CREAT))
            except BlockingIOError:
                problem = "another service runs on it; stop that, or state a folder of its own"
                raise BadInputError(f"store.folder: {folder}: {problem}") from None
            except OSError:
                pass  # it cannot be used now: the store tells
        yield


SCHEMA = """
CREATE TABLE IF NOT EXISTS states (
    name TEXT NOT NULL, axis TEXT NOT NULL, body TEXT NOT NULL, digest INTEGER NOT NULL,
    PRIMARY KEY (name, axis)
);
"""


class DamagedStateError(Exception):
    """Reason why a kept state is not what was written."""


@dataclass(frozen=True, slots=True)
class State:
    """State of one part of an axis, as JSON text; None: it is gone."""

    name: str
    axis: str
    body: str | None

    @classmethod
    def of(cls, name: str, axis: str, document: object) -> "State":
        """State of a document. Raises ValueError where JSON cannot hold it."""
        return cls(name, axis, json.dumps(document, allow_nan=False))


def put_state(file: sqlite3.Connection, state: State) -> None:
    """Write a state within a transaction, in the place of an older one."""
    if state.body is None:
        gone = "DELETE FROM states WHERE name = ? AND axis = ?"
        file.execute(gone, (state.name, state.axis))
        return
    key = (state.name, state.axis, state.body)
    row = (*key, digest(*key))
    file.execute("INSERT OR REPLACE INTO states VALUES (?, ?, ?, ?)", row)


def load_state(store: Store, name: str, axis: str) -> Any:
    """Document of a state; None if there is none. Raises DamagedStateError, StoreFailedError."""
    store.define(SCHEMA)
    wanted = "SELECT body, digest FROM states WHERE name = ? AND axis = ?"
    row = store.read(lambda file: file.execute(wanted, (name, axis)).fetchone())
    if row is None:
        return None
    if row[1] != digest(name, axis, row[0]):
        raise DamagedStateError("its checksum is wrong")
    try:
        return json.loads(row[0])
    except (ValueError, RecursionError) as error:
        raise DamagedStateError(str(error)) from None


def set_state_aside(store: Store, name: str, axis: str) -> str:
    """Keep a damaged state under another name; returns that. Raises StoreFailedError."""
    aside = damaged_name(name)
    renamed = "UPDATE OR REPLACE states SET name = ? WHERE name = ? AND axis = ?"
    store.write(lambda file: file.execute(renamed, (aside, name, axis)))
    return aside


def digest(*parts: object) -> int:
    """Checksum of a row, by which damage in it is seen."""
    return crc32(" ".join(map(str, parts)).encode())
