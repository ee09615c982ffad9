"""A service that is killed at random, and its work killed at every call that changes a file.

python -m tests.bench.faults.crash --kills 200 --calls 1000          # needs strace
"""

import io
import os
import random
import signal
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..table import Figure, PipelineBench
from .every_call import every_call
from .kept import set_clock, shifted
from .scene import RunningService, configuration, running_service

AXES = ("A1", "A2")
MOST_READY_S = 3.0
_CLOCK = "tests.bench.faults.shifted_clock"
_LAST_S = 1.3
"""Time of the newest estimates that a kill may take, s: they are written once a second."""
_SHORTEST_S, _LONGEST_S = 1.5, 5.0
_HOUR_S = 3600.0


@dataclass(slots=True)
class Toll:
    """Outcome of many kills of a service."""

    kills: int = 0
    estimates: int = 0
    lost: int = 0
    doubled: int = 0
    notes: list[str] = field(default_factory=list)
    ready_s: list[float] = field(default_factory=list)


def kill_at_random(work: Path, kills: int, rng: random.Random) -> Toll:
    """Kill a service again and again over the same folder, often around the end of an hour."""
    work.mkdir()
    clock, toll = work / "clock", Toll()
    heard: dict[str, Any] = {axis: np.empty(0) for axis in AXES}
    start_s = time.time() // _HOUR_S * _HOUR_S - _HOUR_S * (kills + 1) / 2.0
    config = configuration(AXES, folder=work / "history")
    with shifted(clock, start_s):
        for number in range(kills + 1):
            end_s = start_s + _HOUR_S * (number + 1) / 2.0
            set_clock(clock, end_s - rng.uniform(0.0, 6.0))
            with running_service(config, work, _CLOCK) as service:
                toll.ready_s.append(service.wait_ready())
                _compare(service, heard, start_s, toll)
                if number == kills:
                    return toll
                _live(service, rng, number, toll)
                now_s = _now_s(clock)
                heard = {axis: _times(service, axis, start_s, now_s) for axis in AXES}
                heard = {axis: times[times < now_s - _LAST_S] for axis, times in heard.items()}
                os.kill(service.pid, signal.SIGKILL)
                toll.kills += 1
    return toll


def _live(service: RunningService, rng: random.Random, number: int, toll: Toll) -> None:
    """Let it work for a while; a note that it has accepted is acknowledged."""
    time.sleep(rng.uniform(_SHORTEST_S, _LONGEST_S))
    note = f"note {number}"
    body = {"action": "note", "user": "Kim", "note": note}
    if service.ask("/api/v1/axes/A1/commands", "POST", body).status == 202:
        toll.notes.append(note)


def _compare(service: RunningService, heard: dict[str, Any], start_s: float, toll: Toll) -> None:
    """Count what is missing of what was heard before the kill, and what is there twice."""
    for axis, times in heard.items():
        kept = _times(service, axis, start_s, times[-1] + 1.0) if times.size else times
        toll.estimates = max(toll.estimates, kept.size)
        toll.lost += int(np.setdiff1d(times, kept).size)
        toll.doubled += int(kept.size - np.unique(kept).size)
    answer = service.ask(f"/api/v1/axes/A1/log?from={start_s}&limit=20000").json
    said = [event["message"] for event in answer["events"] if event["kind"] == "note"]
    expected = [f"{note} (Kim)" for note in toll.notes]
    toll.lost += len(set(expected) - set(said))
    toll.doubled += len(said) - len(set(said))


def _now_s(clock: Path) -> float:
    return time.time() + float(clock.read_text())


def _times(service: RunningService, axis: str, start_s: float, end_s: float) -> Any:
    """UNIX times of the single estimates kept in a span, s; files give every one of 8 h."""
    import pyarrow.parquet as pq

    found = [np.empty(0)]
    for from_s in np.arange(start_s, end_s, 8.0 * _HOUR_S):
        span = f"from={from_s}&to={min(from_s + 8.0 * _HOUR_S, end_s)}"
        body = service.ask(f"/api/v1/axes/{axis}/history.parquet?{span}").body
        found.append(pq.read_table(io.BytesIO(body)).column("time").cast("int64").to_numpy() / 1e6)
    return np.concatenate(found)


def crash(work: Path, kills: int, calls: int, seed: int = 1) -> PipelineBench:
    """Kill services at random, and processes at every call."""
    toll = kill_at_random(work / "kills", kills, random.Random(seed))
    (work / "calls").mkdir()
    losses = every_call(work / "calls", calls)
    lost = toll.lost + sum(each.lost for each in losses)
    doubled = toll.doubled + sum(each.doubled for each in losses)
    ready_s = float(np.median(toll.ready_s))
    figures = (
        Figure("kills", "services killed at random", float(toll.kills), ""),
        Figure("calls", "killed on entering a call", float(len(losses)), ""),
        Figure("estimates", "estimates of an axis in the end", float(toll.estimates), ""),
        Figure("notes", "notes acknowledged", float(len(toll.notes)), ""),
        Figure("lost", "acknowledged and lost", float(lost), "", at_most=0.0),
        Figure("doubled", "doubled", float(doubled), "", at_most=0.0),
        Figure("ready_s", "page to ready, median", ready_s, "s", at_most=MOST_READY_S),
    )
    return PipelineBench(figures, (f"page to ready, longest: {max(toll.ready_s):.1f} s",))


@click.command()
@click.option("--kills", type=click.IntRange(0), default=200, show_default=True)
@click.option("--calls", type=click.IntRange(0), default=1000, show_default=True)
def main(kills: int, calls: int) -> None:
    """Print what a service that is killed keeps of what it had acknowledged."""
    with tempfile.TemporaryDirectory() as name:
        click.echo(crash(Path(name), kills, calls).as_text())


if __name__ == "__main__":
    main()
