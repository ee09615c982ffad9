"""Healthy twins of a motion, kept between runs of the command where a folder allows it."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from .. import __version__
from ..atomic import replaced_file
from ..diagnose.recorded import Run
from ..diagnose.session import Session
from ..diagnose.twin import HealthyGap, healthy_gap, healthy_session, setpoints_of
from ..models.machine import Machine

_VERSION = 1


def healthy_gap_of(
    machine: Machine,
    runs: Sequence[Run],
    count: int,
    progress: Callable[[str], None] = lambda _line: None,
) -> HealthyGap:
    """The healthy gap of a motion, from the cache or simulated."""
    path = _folder() / f"{_digest(machine, runs, count)}.json"
    known = _read(path)
    if known is not None:
        return known
    found = healthy_gap(_twins(machine, runs, count, progress), machine)
    _write(path, found)
    return found


def _twins(
    machine: Machine, runs: Sequence[Run], count: int, progress: Callable[[str], None]
) -> Iterator[Session]:
    for number in range(count):
        progress(f"healthy twin {number + 1} of {count}")
        yield healthy_session(machine, runs, number)


def _folder() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111
    return Path(home) / "edge-service" / "twin"


def _digest(machine: Machine, runs: Sequence[Run], count: int) -> str:
    ratio = machine.transmission_ratio_m_per_rad
    seen = hashlib.sha256(f"{_VERSION} {__version__} {count} {machine.model_dump_json()}".encode())
    for run in runs:
        seen.update(np.round(setpoints_of(run, ratio)[:, 0], 6).tobytes())
        seen.update(json.dumps({k: f"{v:.1e}" for k, v in sorted(run.noise.items())}).encode())
    return seen.hexdigest()[:32]


def _read(path: Path) -> HealthyGap | None:
    try:
        known = json.loads(path.read_text("utf-8"))
        return HealthyGap(
            {name: tuple(map(float, values)) for name, values in known["before"].items()},
            {name: tuple(map(float, values)) for name, values in known["left"].items()},
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _write(path: Path, found: HealthyGap) -> None:
    """Keep it; a cache that cannot be written is none."""
    try:
        with replaced_file(path) as file:
            json.dump({"before": found.before, "left": found.left}, file)
    except OSError:
        return
