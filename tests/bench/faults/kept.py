"""The folder that a service keeps: some hours of work, with all kinds of files that there are."""

import os
import re
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from unittest.mock import patch

from edge_service.atomic import DAMAGED, replaced_file

from .scene import RunningService, configuration, running_service
from .shifted_clock import VARIABLE

_HOUR_S = 3600.0
_BEFORE_S, _AFTER_S = 5.0, 5.0
_OTHERS = re.compile(rf"\{DAMAGED}|lock$|-shm$|^recording_")
_CHECKOUT = Path(__file__).parents[3]


def keep(folder: Path, axes: tuple[str, ...], hours: int) -> Path:
    """Let a service work around the ends of the last hours; its folder of history."""
    kept, clock = folder / "history", folder / "clock"
    last_s = time.time() // _HOUR_S * _HOUR_S
    ends_s = [last_s - _HOUR_S * back for back in range(hours - 1, -1, -1)]
    with shifted(clock, ends_s[0] - _BEFORE_S):
        config = configuration(axes, folder=kept, scenario="gradual")
        with running_service(config, folder, "tests.bench.faults.shifted_clock") as service:
            service.wait_ready()
            for number, end_s in enumerate(ends_s):
                set_clock(clock, end_s - _BEFORE_S)
                _note(service, axes, number)
                _job(service, axes[0], number)
                time.sleep(_BEFORE_S + _AFTER_S)
    return kept


@contextmanager
def shifted(clock: Path, time_s: float) -> Iterator[None]:
    """A clock of the services started inside, which shows a UNIX time now."""
    set_clock(clock, time_s)
    path = os.pathsep.join(filter(None, [str(_CHECKOUT), os.environ.get("PYTHONPATH")]))
    with patch.dict(os.environ, {VARIABLE: str(clock), "PYTHONPATH": path}):
        yield


def set_clock(clock: Path, time_s: float) -> None:
    """Let the shifted clock show a UNIX time now."""
    with replaced_file(clock) as file:
        file.write(str(time_s - time.time()))


def _note(service: RunningService, axes: tuple[str, ...], number: int) -> None:
    for axis in axes:
        body = {"action": "note", "user": "Kim", "note": f"note {number}"}
        service.ask(f"/api/v1/axes/{axis}/commands", "POST", body)


def _job(service: RunningService, axis: str, number: int) -> None:
    """Upload a recording that is none, and have it looked at: the record of the job is kept."""
    name = f"recording_{number}.csv"
    service.ask(f"/api/v1/recordings/{name}", "PUT", b"time,torque\n0.0,1.0\n")
    body = {"kind": "fingerprint", "axis": axis, "recordings": [name]}
    service.ask("/api/v1/jobs", "POST", body)


def unreachable(axes: tuple[str, ...], folder: Path) -> str:
    """Configuration in which nothing is heard: all that is answered comes from the folder."""
    nothing = folder.with_name("nothing")
    nothing.mkdir(exist_ok=True)
    simulated = re.compile(r'driver = "simulated"\n\[axes\.settings\]\n.*\n.*\n')
    watched = f'driver = "folder"\n[axes.settings]\nfolder = "{nothing}"\n'
    return simulated.sub(watched, configuration(axes, folder=folder))


def files(kept: Path) -> list[Path]:
    """All that is kept, of every kind, as paths within the folder.

    Not what was set aside, the lock, the index that SQLite makes anew at every start, and what
    people upload, which is judged when it is used.
    """
    found = (path.relative_to(kept) for path in sorted(kept.rglob("*")) if path.is_file())
    return [path for path in found if not _OTHERS.search(path.name)]


def content(path: Path) -> bytes | tuple[str, ...]:
    """Content of a kept file: of a database all that can be read of it, of others their bytes."""
    if path.suffix != ".sqlite" or ".copy" in path.name:
        return path.read_bytes()
    try:
        with closing(sqlite3.connect(f"file:{path.absolute()}?mode=ro", uri=True)) as file:
            ((sound,),) = file.execute("PRAGMA integrity_check(1)").fetchall()
            return (str(sound), *file.iterdump())
    except (sqlite3.Error, UnicodeDecodeError):
        return path.read_bytes()


def kind(path: Path) -> str:
    """Kind of a kept file: its name without axis, time and number."""
    return re.sub(r"\d[\dT:-]*", "*", re.sub(r"axis=[^/]+", "axis=*", path.as_posix()))
