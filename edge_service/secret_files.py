"""Secrets in files of their own, or among the credentials that systemd hands over."""

import logging
import os
import stat
from pathlib import Path

log = logging.getLogger(__name__)
CREDENTIALS = "$CREDENTIALS_DIRECTORY"
"""Beginning of a path that leads to the credentials of the unit."""
MOST_BYTES = 65_536


class SecretError(Exception):
    """A file that holds no secret that may be used; the text is one line without the secret."""


def secret_path(folder: Path, path: Path) -> Path:
    """Path of a secret: among the credentials, or relative to `folder`."""
    return path if path.parts[:1] == (CREDENTIALS,) else folder / path


def read_secret(path: Path, *, private: bool = True) -> str:
    """Secret in a file, without blanks around it.

    Args:
        private: others must not be able to read or change it: nobody but its owner; its group too
            if root owns it, as root may hand a file to the service's group. Else that is logged.

    Raises:
        SecretError: there is no such file, no text in it, or others may read it.
    """
    place = expanded(path)
    try:
        handle = os.open(place, os.O_RDONLY | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            _check(path, os.fstat(handle), private=private)
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


def expanded(path: Path) -> Path:
    """Real path of a secret. Raises SecretError: there are no credentials."""
    if path.parts[:1] != (CREDENTIALS,):
        return path
    folder = os.environ.get(CREDENTIALS.removeprefix("$"))
    if not folder:
        raise SecretError(f"{path}: {CREDENTIALS} is not set; systemd sets it (LoadCredential=)")
    return Path(folder, *path.parts[1:])


def _check(path: Path, status: os.stat_result, *, private: bool) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise SecretError(f"{path}: expected a file")
    allowed = stat.S_IRWXU | (stat.S_IRGRP if status.st_uid == 0 else 0)
    mode = stat.S_IMODE(status.st_mode)
    if mode & ~allowed:
        problem = f"{path}: others may read or change it (mode {mode:o}); chmod 600 it"
        if private:
            raise SecretError(problem)
        log.warning("%s", problem)
