"""Secrets: which keys they are, and how they come from files of their own or from systemd."""

import os
import stat
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, SecretStr

CREDENTIALS = "$CREDENTIALS_DIRECTORY"
"""Beginning of a path that leads to the credentials of the unit."""
MOST_BYTES = 65_536


class SecretError(Exception):
    """A file that holds no secret that may be used; the text is one line without the secret."""


def secret_keys(model: type[BaseModel]) -> tuple[str, ...]:
    """Keys of a table that hold secrets; each has a key `..._file` beside it."""
    fields = model.model_fields.items()
    kinds = {name: (each.annotation, *get_args(each.annotation)) for name, each in fields}
    return tuple(name for name, kind in kinds.items() if SecretStr in kind)


def with_secrets(model: type[BaseModel], content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The content of a table with the secrets in place of the files that hold them.

    Raises SecretError: one line with the key, without the secret.
    """
    read = {}
    for key in secret_keys(model):
        name = content.get(f"{key}_file")
        if not isinstance(name, str):
            continue
        if key in content:
            raise SecretError(f"{key}: there is {key}_file as well; one of the two is enough")
        try:
            read[key] = read_secret(secret_path(folder, Path(name)))
        except SecretError as error:
            raise SecretError(f"{key}_file: {error}") from None
    return content | read


def open_secrets(content: dict[str, Any], path: Path) -> list[str]:
    """Mistakes of a configuration with passwords that others may read, `key: what to do`."""
    problem = _exposed(path.stat())
    if not problem:
        return []
    outputs, axes = content.get("outputs"), content.get("axes")
    tables: dict[str, Any] = {}
    if isinstance(outputs, dict):
        tables |= {f"outputs.{name}": table for name, table in outputs.items()}
    for axis in axes if isinstance(axes, list) else ():
        if isinstance(axis, dict):
            tables[f"axes.{axis.get('name')}.settings"] = axis.get("settings")
    return [
        f"{name}.password: {problem}; chmod 600 {path}, or use password_file"
        for name, table in tables.items()
        if isinstance(table, dict) and "password" in table
    ]


def _exposed(status: os.stat_result) -> str:
    """Problem with a file that others than its owner, or root's group, may read or change."""
    allowed, mode = (0o740 if status.st_uid == 0 else 0o700), stat.S_IMODE(status.st_mode)
    return f"others may read or change it (mode {mode:o})" if mode & ~allowed else ""


def secret_path(folder: Path, path: Path) -> Path:
    """Path of a secret: among the credentials, or relative to `folder`."""
    return path if path.parts[:1] == (CREDENTIALS,) else folder / path


def expanded(path: Path) -> Path:
    """Real path of a secret. Raises SecretError: there are no credentials."""
    if path.parts[:1] != (CREDENTIALS,):
        return path
    folder = os.environ.get(CREDENTIALS.removeprefix("$"))
    if not folder:
        raise SecretError(f"{path}: {CREDENTIALS} is not set; systemd sets it (LoadCredential=)")
    return Path(folder, *path.parts[1:])


def read_secret(path: Path) -> str:
    """Secret in a file that its owner alone may read, without blanks around it.

    Its group may read it too if root owns it, as root may hand a file to the service's group.

    Raises SecretError: there is no such file, no text in it, or others may read or change it.
    """
    place = expanded(path)
    try:
        handle = os.open(place, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise SecretError(f"{path}: expected a file")
            if problem := _exposed(status):
                raise SecretError(f"{path}: {problem}; chmod 600 {place}")
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise SecretError(f"{path}: {error.strerror}") from None
    try:
        secret = content.decode().strip()
    except UnicodeDecodeError:
        raise SecretError(f"{path}: expected text in UTF-8") from None
    if not secret or len(content) > MOST_BYTES:
        raise SecretError(f"{path}: expected 1 to {MOST_BYTES} bytes")
    return secret
