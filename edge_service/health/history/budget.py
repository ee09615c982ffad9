"""Disk budget of the history: what was left over and the oldest single estimates make room."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ...atomic import DAMAGED, PART
from ...clock import is_future, now_ns
from .tier import HOUR, MINUTE, RAW, Resolution

_LEFT_OVER = re.compile(rf"\..+(\{PART}|\.[a-z0-9_]{{8}})")
"""Names of files that were never finished, those of earlier versions too."""
_LEFT_OVER_AFTER_S = 3600.0
_RESOLUTIONS = (RAW, MINUTE, HOUR)
_TIERS = {each.name for each in _RESOLUTIONS}


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

    First what was damaged, then what is dated after now, then the single estimates, oldest first
    over all axes, then the minutes; hours that are over (about a megabyte a year and axis), events
    and notes always stay. OSError.
    """
    used = sum(_size(path) for path in folder.glob("axis=*/**/*"))
    removed = 0
    for path in dict.fromkeys(_dispensable(folder, now_ns() / 1e9)):
        if used <= budget_bytes:
            break
        used -= _size(path)
        path.unlink(missing_ok=True)
        removed += 1
    return removed


def _dispensable(folder: Path, now_s: float) -> Iterator[Path]:
    damaged = (path for path in folder.glob(f"axis=*/**/*{DAMAGED}") if path.is_file())
    yield from sorted(damaged, key=lambda path: path.name)
    for resolution in _RESOLUTIONS:
        files = _files(folder, resolution)
        yield from (path for path in files if _is_future(resolution, path, now_s))
    for resolution in (RAW, MINUTE):
        yield from _files(folder, resolution)


def _files(folder: Path, resolution: Resolution) -> list[Path]:
    files = folder.glob(f"axis=*/{resolution.name}/*.parquet")
    return sorted(files, key=lambda path: path.name)


def _is_future(resolution: Resolution, path: Path, now_s: float) -> bool:
    try:
        return is_future(resolution.start_s(path.stem), now_s)
    except ValueError:  # no file of ours
        return False


def _size(path: Path) -> int:
    with suppress(FileNotFoundError):
        return path.stat().st_size if path.is_file() else 0
    return 0
