"""Somebody sets the wall clock of a running service: what becomes of its preload and its trend?

python -m tests.bench.faults.clock
"""

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import click

from edge_service.clock import HOLD_S

from ..table import Figure, PipelineBench
from .scene import RunningService, configuration, running_service

VARIABLE = "EDGE_SERVICE_WALL_CLOCK"
_YEAR_S = 365.25 * 86400.0
STEPS_S = {
    "wrong year for 5 s": (74 * _YEAR_S, 5.0),
    "two hours back": (-7200.0, HOLD_S + 15.0),
    "1970": (-56 * _YEAR_S, HOLD_S + 15.0),
    "2100": (74 * _YEAR_S, HOLD_S + 15.0),
}
"""How far the clock is set, s, and for how long, s; then it is set right again."""
_LEARN_S, _LOOK_PERIOD_S = 40.0, 0.25
MOST_SHIFT = 0.2
"""Percent of the load rating."""


def set_wall_clock(path: Path) -> None:
    """Let the wall clock alone differ from the real time by the seconds in a file."""
    real_s, real_ns = time.time, time.time_ns
    time.time = lambda: real_s() + float(path.read_text() or 0.0)
    time.time_ns = lambda: real_ns() + round(float(path.read_text() or 0.0) * 1e9)


def preload(service: RunningService) -> float | None:
    """Present preload, percent of the load rating."""
    number: float | None = service.ask("/api/v1/axes/X/preload").json["preload_percent"]
    return number


def trend(service: RunningService) -> Any:
    """What the trend says now."""
    return service.ask("/api/v1/axes/X/health").json["trend"]


def looks(service: RunningService, seconds: float) -> list[float | None]:
    """Preload again and again for some seconds."""
    end_s, seen = time.monotonic() + seconds, []
    while time.monotonic() < end_s:
        seen.append(preload(service))
        time.sleep(_LOOK_PERIOD_S)
    return seen


def set_clock(folder: Path, step_s: float, for_s: float) -> dict[str, float]:
    """One service whose clock is set, and set right again; what was seen."""
    offset, state = folder / "offset", folder / "history" / "axis=X" / "estimate.json"
    offset.write_text("0")
    os.environ[VARIABLE] = str(offset)
    config = configuration(("X",), folder=folder / "history")
    with running_service(config, folder, "tests.bench.faults.clock") as service:
        service.wait_ready()
        time.sleep(_LEARN_S)
        before = preload(service)
        offset.write_text(repr(step_s))
        seen = looks(service, for_s)
        offset.write_text("0")
        seen += looks(service, HOLD_S + 15.0)
        kept_s = state.stat().st_mtime if state.exists() else 0.0
        first = trend(service)
        seen += looks(service, 70.0)
        kept = state.exists() and state.stat().st_mtime > kept_s
        goes_on = trend(service) != first
    shifts = [abs(each - before) for each in seen if each is not None and before is not None]
    without = sum(each is None for each in seen)
    return {"shift": max(shifts), "without": without, "goes_on": goes_on, "kept": kept}


def set_clocks(folder: Path, names: list[str]) -> PipelineBench:
    """All steps, one after another."""
    figures: list[Figure] = []
    for number, name in enumerate(names):
        place = folder / str(number)
        place.mkdir()
        seen = set_clock(place, *STEPS_S[name])
        key = name.replace(" ", "_")
        figures += [
            Figure(f"{key}_shift", f"{name}: shift", seen["shift"], "%", at_most=MOST_SHIFT),
            Figure(f"{key}_without", "looks without a number", seen["without"], "", at_most=0.0),
            Figure(f"{key}_trend", "the trend goes on", seen["goes_on"], "", at_least=1.0),
            Figure(f"{key}_kept", "the state is kept on", seen["kept"], "", at_least=1.0),
        ]
    return PipelineBench(tuple(figures), ("one axis, wall clock set and set right again",))


@click.command()
@click.option("--only", "names", type=click.Choice(list(STEPS_S)), multiple=True)
def main(names: tuple[str, ...]) -> None:
    """Print what becomes of preload and trend when the clock is set."""
    with tempfile.TemporaryDirectory() as folder:
        click.echo(set_clocks(Path(folder), list(names or STEPS_S)).as_text())


if __name__ == "__main__":
    if VARIABLE in os.environ:
        set_wall_clock(Path(os.environ[VARIABLE]))
        from edge_service.cli.entry import main as serve

        raise SystemExit(serve())
    main()
