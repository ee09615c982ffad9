"""Secrets of a configuration: which keys they are, and how they come from files of their own."""

import stat
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, SecretStr

from .secret_files import SecretError, read_secret, secret_path


def secret_keys(model: type[BaseModel]) -> tuple[str, ...]:
    """Keys of a table that hold secrets; each has a key `..._file` beside it."""
    fields = model.model_fields.items()
    return tuple(
        name
        for name, field in fields
        if SecretStr in (field.annotation, *get_args(field.annotation))
    )


def with_secrets(model: type[BaseModel], content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The content of a table with the secrets in place of the files that hold them.

    Args:
        folder: that paths are relative to.

    Raises:
        SecretError: one line with the key, without the secret.
    """
    read = {
        key: _read(key, content, folder)
        for key in secret_keys(model)
        if isinstance(content.get(f"{key}_file"), str)
    }
    return content | read


def open_secrets(content: dict[str, Any], path: Path) -> list[str]:
    """Passwords of outputs and drivers that stand in a file which others may read."""
    if not path.stat().st_mode & stat.S_IROTH:
        return []
    outputs, axes = content.get("outputs"), content.get("axes")
    tables: dict[str, Any] = {}
    if isinstance(outputs, dict):
        tables |= {f"outputs.{name}": table for name, table in outputs.items()}
    for number, axis in enumerate(axes if isinstance(axes, list) else ()):
        if isinstance(axis, dict):
            tables[f"axes[{number}].settings"] = axis.get("settings")
    return [
        f"{name}.password"
        for name, table in tables.items()
        if isinstance(table, dict) and "password" in table
    ]


def _read(key: str, content: dict[str, Any], folder: Path) -> str:
    if key in content:
        raise SecretError(f"{key}: there is {key}_file as well; one of the two is enough")
    try:
        return read_secret(secret_path(folder, Path(content[f"{key}_file"])), private=False)
    except SecretError as error:
        raise SecretError(f"{key}_file: {error}") from None
