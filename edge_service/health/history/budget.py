"""Disk budget of the history: the oldest single estimates make room first."""

from pathlib import Path

from .tier import MINUTE, RAW


def make_room(folder: Path, budget_bytes: int) -> int:
    """Remove the oldest files until the axes' folders fit the budget; returns how many went.

    First the single estimates, oldest first over all axes, then the minutes; hours (about a
    megabyte a year and axis), events and notes always stay.
    """
    used = sum(path.stat().st_size for path in folder.glob("axis=*/**/*") if path.is_file())
    removed = 0
    for resolution in (RAW, MINUTE):
        files = folder.glob(f"axis=*/{resolution.name}/*.parquet")
        for path in sorted(files, key=lambda path: path.name):
            if used <= budget_bytes:
                return removed
            used -= path.stat().st_size
            path.unlink()
            removed += 1
    return removed
