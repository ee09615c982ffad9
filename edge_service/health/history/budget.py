"""Disk budget of the history: what was left over and the oldest single estimates make room."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ...atomic import DAMAGED, PART
from ...clock import now_ns
from .tier import HOUR, MINUTE, RAW

_LEFT_OVER = re.compile(rf"\..+(\{PART}|\.[a-z0-9_]{{8}})")
"""Names of files that were never finished, those of earlier versions too."""
_LEFT_OVER_AFTER_S = 3600.0
_TIERS = {each.name for each in (RAW, MINUTE, HOUR)}


def sweep(folder: Path) -> int:
    """Remove what crashes left unfinished; returns how many files. Raises OSError.

    Files of tiers are written by the holder of the folder alone; others may be in work just now.
    """
    now_s = now_ns() / 1e9
    removed = 0
    for path in folder.rglob(".*"):
        if not _LEFT_OVER.fullmatch(path.name) or not path.is_file():
            continue
        age_s = abs(now_s - path.stat().st_mtime)
        if path.parent.name in _TIERS or age_s > _LEFT_OVER_AFTER_S:
            path.unlink(missing_ok=True)
            removed += 1
    return removed


def make_room(folder: Path, budget_bytes: int) -> int:
    """Remove the oldest files until the axes' folders fit the budget; returns how many went.

    First what was damaged, then the single estimates, oldest first over all axes, then the
    minutes; hours (about a megabyte a year and axis), events and notes always stay. OSError.
    """
    used = sum(_size(path) for path in folder.glob("axis=*/**/*"))
    removed = 0
    for path in _dispensable(folder):
        if used <= budget_bytes:
            break
        used -= _size(path)
        path.unlink(missing_ok=True)
        removed += 1
    return removed


def _dispensable(folder: Path) -> Iterator[Path]:
    damaged = (path for path in folder.glob(f"axis=*/**/*{DAMAGED}") if path.is_file())
    yield from sorted(damaged, key=lambda path: path.name)
    for resolution in (RAW, MINUTE):
        files = folder.glob(f"axis=*/{resolution.name}/*.parquet")
        yield from sorted(files, key=lambda path: path.name)


def _size(path: Path) -> int:
    with suppress(FileNotFoundError):
        return path.stat().st_size if path.is_file() else 0
    return 0
