"""Store in which the state of alarms, trends and use outlives the process."""

import json
import logging
from pathlib import Path
from typing import Any

from ...atomic import replaced_file
from ...health.axis_monitor import AxisMonitor

log = logging.getLogger(__name__)


def axis_folder(folder: Path, axis: str) -> Path:
    """Folder of one axis; tools that know Hive partitions read the axis from its name."""
    return folder / f"axis={axis}"


def snapshot_path(folder: Path, axis: str) -> Path:
    """File of one axis."""
    return axis_folder(folder, axis) / "watch.json"


def load_snapshot(folder: Path, monitor: AxisMonitor) -> None:
    """Let a monitor go on where it was; a damaged file is set aside, and logged."""
    path = snapshot_path(folder, monitor.axis)
    if not path.exists():
        return
    try:
        monitor.restore(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, RecursionError) as error:
        aside = path.with_suffix(".damaged")
        path.replace(aside)
        log.warning("%s: cannot be read, kept as %s (%s)", path, aside.name, error)


def save_snapshot(folder: Path, axis: str, snapshot: dict[str, Any]) -> None:
    """Write the state of one axis, whole or not at all. Raises OSError."""
    with replaced_file(snapshot_path(folder, axis)) as file:
        json.dump(snapshot, file, allow_nan=False)
