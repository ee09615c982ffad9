"""Names that may come from anywhere: each is checked here before it becomes part of a key or path.

A checked name holds no slash and no control character, so none leads out of a folder.
"""

import re
from typing import Annotated

from pydantic import AfterValidator

_PART = re.compile(r"[A-Za-z0-9_.\-]{1,100}")
_COLUMN = re.compile(r"[^\x00-\x1f\x7f/\\]{1,100}")
_KIND = re.compile(r"[a-z][a-z0-9_]{0,63}")
_RECORDING = re.compile(r"disagreement_([A-Za-z0-9_.\-]{1,100})_\d{8}T\d{6}Z\.parquet")


def check_part(part: str) -> str:
    """Return `part` if it can stand between two slashes of a key; raise ValueError if not."""
    if not _PART.fullmatch(part):
        raise ValueError(f"{_shown(part)} is no key part: use letters, digits, '_', '-' and '.'")
    return part


def check_column(name: str) -> str:
    """Return `name` if it can be that of a channel or sensor; raise ValueError if not."""
    if not _COLUMN.fullmatch(name):
        raise ValueError(f"{_shown(name)} is no name of a channel")
    return name


def check_kind(kind: str) -> str:
    """Return `kind` if it can name a kind of event; raise ValueError if not."""
    if not _KIND.fullmatch(kind):
        raise ValueError(f"{_shown(kind)} is no kind of event: use a-z, 0-9 and '_'")
    return kind


def check_recording(name: str, axis: str | None = None) -> str:
    """Return `name` if it can be that of a recording by the service; raise ValueError if not.

    Args:
        axis: whose recording it must be; None for any.
    """
    found = _RECORDING.fullmatch(name)
    if found is None or axis not in (None, found[1]):
        raise ValueError(f"{_shown(name)} is no name of a recording by the service")
    return name


def _shown(name: str) -> str:
    return repr(name if len(name) <= 40 else name[:40] + "...")


Column = Annotated[str, AfterValidator(check_column)]
Kind = Annotated[str, AfterValidator(check_kind)]
