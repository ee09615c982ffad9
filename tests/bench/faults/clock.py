"""Somebody sets the wall clock of a running service: what becomes of its preload and its trend?

A young estimate still moves by itself, so every run is held, second by second, against one of the
same seed whose clock nobody sets.

python -m tests.bench.faults.clock
"""

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

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
"""Step of the clock, s, and its length, s; then it is set right again."""
_LEARN_S, _AFTER_S, _KEEP_S = 40.0, HOLD_S + 15.0, 70.0
_LOOK_PERIOD_S, _AGAIN_S = 0.25, 5.0
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
    """Answer of the trend now."""
    return service.ask("/api/v1/axes/X/health").json["trend"]


Looks = list[tuple[float, float | None]]
"""Times since the service was ready, s, and preloads, percent."""


def looks(service: RunningService, ready_s: float, seconds: float) -> Looks:
    """Preload again and again for some seconds."""
    end_s, seen = time.monotonic() + seconds, []
    while time.monotonic() < end_s:
        seen.append((time.monotonic() - ready_s, preload(service)))
        time.sleep(_LOOK_PERIOD_S)
    return seen


def numbers(seen: Looks) -> tuple[list[float], list[float]]:
    """Times and preloads of the looks that found a number."""
    found = [(at_s, percent) for at_s, percent in seen if percent is not None]
    return [at_s for at_s, _ in found], [percent for _, percent in found]


def shift_between(seen: Looks, undisturbed: Looks) -> float:
    """Greatest difference of two runs at the same time, percent."""
    at_s, percent = numbers(seen)
    return float(np.abs(np.array(percent) - np.interp(at_s, *numbers(undisturbed))).max())


def undisturbed_run(folder: Path) -> Looks:
    """A service of the same seed whose clock nobody sets."""
    config = configuration(("X",), folder=folder / "history")
    with running_service(config, folder) as service:
        service.wait_ready()
        longest_s = max(for_s for _, for_s in STEPS_S.values())
        return looks(service, time.monotonic(), _LEARN_S + longest_s + _AFTER_S + _KEEP_S)


def told(service: RunningService, kind: str) -> int:
    """Events of a kind, whatever time they carry."""
    events = service.ask("/api/v1/axes/X/log?from=0&to=9e9").json["events"]
    return sum(event["kind"] == kind for event in events)


@dataclass(frozen=True, slots=True)
class After:
    """Outcome of a clock that was set, and set right again.

    Attributes:
        seen: looks at the preload since then.
        goes_on, kept: whether the trend goes on, and whether the estimate's state is kept on.
        steps: steps that were told.
        named: events that name what is dated after now.
        goes_on_again: whether a second start on the same folder is ready and adds rows.
    """

    seen: Looks
    goes_on: bool
    kept: bool
    steps: int
    named: int
    goes_on_again: bool


def goes_on_again(config: str, folder: Path) -> bool:
    """Start once more on the folder; tell whether rows and ids go on."""
    with running_service(config, folder, "tests.bench.faults.clock") as service:
        service.wait_ready()
        begun_s, note = time.time(), '{"action": "note", "user": "clock", "note": "again"}'
        answer = service.ask("/api/v1/axes/X/commands", "POST", note.encode())
        time.sleep(_AGAIN_S)
        rows = service.ask(f"/api/v1/axes/X/history?from={begun_s}&step=1").json["buckets"]
        events = service.ask("/api/v1/axes/X/log").json["events"]
        ids = [event["id"] for event in events]
        return answer.status == 202 and len(rows) > 0 and ids == sorted(set(ids)) and bool(ids)


def set_clock(folder: Path, step_s: float, for_s: float) -> After:
    """One service whose clock is set, and set right again."""
    offset, state = folder / "offset", folder / "history" / "axis=X" / "estimate.json"
    offset.write_text("0")
    os.environ[VARIABLE] = str(offset)
    config = configuration(("X",), folder=folder / "history")
    with running_service(config, folder, "tests.bench.faults.clock") as service:
        service.wait_ready()
        ready_s = time.monotonic()
        time.sleep(_LEARN_S)
        offset.write_text(repr(step_s))
        seen = looks(service, ready_s, for_s)
        offset.write_text("0")
        seen += looks(service, ready_s, _AFTER_S)
        kept_s = state.stat().st_mtime if state.exists() else 0.0
        first = trend(service)
        seen += looks(service, ready_s, _KEEP_S)
        kept = state.exists() and state.stat().st_mtime > kept_s
        goes_on, steps = trend(service) != first, told(service, "clock_changed")
        named = told(service, "history_from_future") + told(service, "diary_from_future")
    return After(seen, goes_on, kept, steps, named, goes_on_again(config, folder))


def set_clocks(folder: Path, names: list[str]) -> PipelineBench:
    """All steps, one after another."""
    place = folder / "undisturbed"
    place.mkdir()
    undisturbed = undisturbed_run(place)
    own = numbers(undisturbed)[1][round(_LEARN_S / _LOOK_PERIOD_S) :]
    figures = [Figure("own", "undisturbed: moves by itself", max(own) - min(own), "%")]
    for number, name in enumerate(names):
        place = folder / str(number)
        place.mkdir()
        after = set_clock(place, *STEPS_S[name])
        step_s, for_s = STEPS_S[name]
        expected = 2.0 if for_s > HOLD_S else 0.0
        named = 2.0 if for_s > HOLD_S and step_s > 0.0 else 0.0
        shift, key = shift_between(after.seen, undisturbed), name.replace(" ", "_")
        without = float(sum(percent is None for _, percent in after.seen))
        figures += [
            Figure(f"{key}_shift", f"{name}: shift", shift, "%", at_most=MOST_SHIFT),
            Figure(f"{key}_without", "looks without a number", without, "", at_most=0.0),
            Figure(f"{key}_trend", "the trend goes on", float(after.goes_on), "", at_least=1.0),
            Figure(f"{key}_told", "steps followed and told", after.steps, "", expected, expected),
            Figure(f"{key}_kept", "the state is kept on", float(after.kept), "", at_least=1.0),
            Figure(f"{key}_named", "kinds from the future, named", after.named, "", named, named),
            Figure(
                f"{key}_again",
                "a second start goes on",
                float(after.goes_on_again),
                "",
                at_least=1.0,
            ),
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
