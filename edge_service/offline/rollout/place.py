"""States of a configuration on its machine: exactly one is in place, and one rename puts it there.

Beside `edge.toml` lies `edge.toml.rollout` with a folder for each state. The files that bundles
govern are links through `edge.toml.rollout/current`, itself a link to the folder of one state: so
all files change at once when that link is renamed, and whoever is killed before or after leaves a
whole state. Kubernetes changes mounted configurations in the same way.
"""

import fcntl
import hashlib
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import ValidationError

from ...atomic import PART, made_folder, replaced_bytes, replaced_file, sync_folder
from ...config.identity import APPLIED, CURRENT, ROLLOUT, Applied
from .contents import RolloutError, check_name

_FILES, _HIGHEST = "files", "highest"
_MOST_BEFORE = 10
"""States that are kept to go back to."""


class Place:
    """Place of a configuration file, and of the states beside it.

    Args:
        config: where the configuration lies, or will lie.
    """

    def __init__(self, config: Path) -> None:
        self.config = config
        self.folder = config.parent
        self.root = config.with_name(config.name + ROLLOUT)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep others from changing it meanwhile. Raises RolloutError, OSError."""
        made_folder(self.folder)
        if not self.root.exists():
            made_folder(self.root)
            _like(self.root, self.folder)
        handle = os.open(self.root, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError:
            raise RolloutError(f"{self.root}: another roll-out is under way") from None
        finally:
            os.close(handle)
            with suppress(OSError):  # it holds a state
                self.root.rmdir()

    @property
    def current(self) -> str:
        """Name of the state in place; empty if nothing was rolled out."""
        try:
            return (self.root / CURRENT).readlink().name
        except OSError:
            return ""

    def applied(self, state: str) -> Applied:
        """Description of a state. Raises RolloutError: there is none, or it is damaged."""
        path = self.root / state / APPLIED
        try:
            described = Applied.model_validate_json(path.read_bytes())
        except (OSError, ValidationError):
            raise RolloutError(f"{path}: is damaged, or missing") from None
        for name in described.files:
            check_name(name)
        return described

    def staged(self, state: str) -> dict[str, bytes]:
        """Files of a state. Raises RolloutError: one is not what was staged. OSError."""
        files = {}
        for name, digest in self.applied(state).files.items():
            files[name] = (self.root / state / _FILES / name).read_bytes()
            if digest_of(files[name]) != digest:
                raise RolloutError(f"{self.root / state}: {name} is damaged")
        return files

    def is_whole(self, state: str) -> bool:
        """Tell whether the files of a state are what was staged: people may have edited them."""
        try:
            return bool(state) and bool(self.staged(state))
        except (RolloutError, OSError):
            return False

    @property
    def now(self) -> Applied | None:
        """Description of the state in place; None if nothing was rolled out."""
        return self.applied(self.current) if self.current else None

    def highest(self) -> int:
        """Greatest number of a bundle that ever was in place; 0 if none was."""
        now = self.now
        try:
            noted = int((self.root / _HIGHEST).read_text())
        except FileNotFoundError:
            noted = 0
        except (OSError, ValueError):
            raise RolloutError(f"{self.root / _HIGHEST}: is damaged") from None
        return max(noted, (now and now.number) or 0)

    def contents(self, names: set[str]) -> dict[str, bytes]:
        """Contents of what lies there now under these names. Raises RolloutError, OSError."""
        found = {}
        for name in sorted(names):
            path = self.folder / name
            if path.is_symlink() and not self._is_ours(name):
                raise RolloutError(f"{path}: is a link to elsewhere, which no roll-out replaces")
            try:
                found[name] = path.read_bytes()
            except (FileNotFoundError, NotADirectoryError):
                continue
        return found

    def changed_here(self) -> list[str]:
        """Names of governed files that are no longer what was put in place."""
        now = self.now
        if now is None:
            return []
        present = self.contents(set(now.files))
        return [
            name for name, digest in now.files.items() if digest_of(present.get(name)) != digest
        ]

    def are_links(self, names: set[str]) -> bool:
        """Tell whether all of these files are links through `current`."""
        return all(self._is_ours(name) for name in names)

    def stage(self, name: str, files: Mapping[str, bytes], applied: Applied) -> None:
        """Write a state beside that in place, whole, on the disk. Raises OSError."""
        part = self.root / f".{secrets.token_hex(4)}{PART}"
        try:
            for each, content in files.items():
                path = part / _FILES / each
                for folder in reversed(path.relative_to(self.root).parents[:-1]):
                    self._make(self.root / folder)
                with replaced_bytes(path) as file:
                    file.write(content)
                _like(path, self.config)
            with replaced_file(part / APPLIED) as text:
                text.write(applied.model_dump_json())
            _like(part / APPLIED, self.config)
            shutil.rmtree(self.root / name, ignore_errors=True)
            part.rename(self.root / name)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        sync_folder(self.root)

    def switch(self, state: str) -> None:
        """Put a staged state in place. Raises RolloutError, OSError; then the old one stands."""
        names, before = set(self.applied(state).files), self.current
        if before:
            with replaced_file(self.root / _HIGHEST) as file:
                file.write(f"{self.highest()}\n")
        for name in names:
            if not os.path.lexists(self.folder / name):
                self._link(name)
        _relink(self.root / CURRENT, Path(state))
        with suppress(OSError):  # it is in place; the next one tidies up
            self.tidy(before)  # which a service that runs may still read

    def take_over(self) -> None:
        """Make governed files that are plain ones links; their content is that of the state."""
        now = self.now
        for name in () if now is None else now.files:
            if not self._is_ours(name):
                self._link(name)

    def tidy(self, also: str = "") -> None:
        """Remove links and states that nothing leads to, and what an interrupted one has left.

        Args:
            also: a state to keep besides.
        """
        kept: list[str] = []
        state = self.current
        while state and state not in kept and len(kept) <= _MOST_BEFORE:
            kept.append(state)
            state = self.applied(state).before if (self.root / state).is_dir() else ""
        names = set().union(*(self._names(each) for each in self.root.iterdir() if each.is_dir()))
        now = self.now
        for name in names - set(now.files if now else ()):
            if self._is_ours(name):
                (self.folder / name).unlink()
        for name in names:
            path = self.folder / name
            for each in path.parent.glob(f".{path.name}.*{PART}"):
                if each.is_symlink() and str(each.readlink()) == self._target(name):
                    each.unlink()
        for each in list(self.root.iterdir()):
            if each.name not in (*kept, also, CURRENT, _HIGHEST):
                shutil.rmtree(each) if each.is_dir() and not each.is_symlink() else each.unlink()

    def _names(self, state: Path) -> set[str]:
        files = state / _FILES
        return {path.relative_to(files).as_posix() for path in files.rglob("*") if path.is_file()}

    def _make(self, folder: Path) -> None:
        if not folder.exists():
            folder.mkdir()
            _like(folder, self.folder)

    def _target(self, name: str) -> str:
        up = "../" * name.count("/")
        return f"{up}{self.root.name}/{CURRENT}/{_FILES}/{name}"

    def _is_ours(self, name: str) -> bool:
        path = self.folder / name
        return path.is_symlink() and str(path.readlink()) == self._target(name)

    def _link(self, name: str) -> None:
        path = self.folder / name
        for folder in reversed(path.relative_to(self.folder).parents[:-1]):
            self._make(self.folder / folder)
        _relink(path, Path(self._target(name)))


def digest_of(content: bytes | None) -> str:
    """Its sha256; empty for a file that is not there."""
    return "" if content is None else hashlib.sha256(content).hexdigest()


def _relink(path: Path, target: Path) -> None:
    """Make `path` a link in one step, whatever it was."""
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    part.symlink_to(target)
    try:
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def _like(path: Path, model: Path) -> None:
    """Give a file or folder the mode and, if root writes it, the owner of another."""
    if not model.exists():
        return
    status = model.stat()
    if os.geteuid() == 0:
        os.chown(path, status.st_uid, status.st_gid)
    path.chmod(status.st_mode & (0o777 if path.is_dir() else 0o666))
