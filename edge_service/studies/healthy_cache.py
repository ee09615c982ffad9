"""Healthy twins of a motion, kept between runs of the command where a folder allows it."""

import concurrent.futures
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from .. import __version__
from ..atomic import replaced_file
from ..diagnose.recorded import Run
from ..diagnose.twin import HealthyGap, excerpt, healthy_gap, healthy_session, joined, setpoints_of
from ..models.machine import Machine

_VERSION = 3
_MOST_KEPT = 200


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
    found = joined(_gaps(machine, runs, count, progress))
    _write(path, found)
    return found


def _gaps(
    machine: Machine, runs: Sequence[Run], count: int, progress: Callable[[str], None]
) -> Iterator[HealthyGap]:
    """Gaps of one twin each; as many at once as there are cores."""

    def gap_of(number: int) -> HealthyGap:
        return healthy_gap([healthy_session(machine, runs, number)], machine)

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, found in enumerate(pool.map(gap_of, range(count)), start=1):
            progress(f"healthy twin {number} of {count}")
            yield found


def _folder() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111
    return Path(home) / "edge-service" / "twin"


def _digest(machine: Machine, runs: Sequence[Run], count: int) -> str:
    ratio = machine.transmission_ratio_m_per_rad
    seen = hashlib.sha256(f"{_VERSION} {__version__} {count} {machine.model_dump_json()}".encode())
    for run in excerpt(runs):
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
        kept = sorted(path.parent.glob("*.json"), key=lambda each: each.stat().st_mtime)
        for old in kept[:-_MOST_KEPT]:
            old.unlink(missing_ok=True)
    except OSError:
        return
