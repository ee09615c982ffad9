"""Commands that read hostile files: one line and status 0 or 2, in bounded memory and time?

python -m tests.bench.faults.files --files 100000
"""

import contextlib
import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import click

from edge_service.exit_status import BAD_INPUT, DONE

from ..table import Figure, PipelineBench
from .hostile_files import right_files, spoiled

KINDS = (
    *("csv", "text", "parquet", "xml", "json", "matlab", "tuning"),
    *("config", "machine"),
)
LIMIT_MB, LIMIT_S = 2500, 3600
MOST_MEMORY_MB, LONGEST_S = 500.0, 20
FILES_AT_ONCE = 500
_SETTINGS = ("config", "machine")
_NUMBERED = """
[columns]
time_s = { column = "#1" }
torque_command_nm = { column = "#2" }
"""
_CONFIG = '[[axes]]\nname = "X"\nmachine = "spoiled.toml"\n'


@dataclass(frozen=True, slots=True)
class Fault:
    """A file that was not answered as it should be: its kind, its seed and what came of it."""

    kind: str
    seed: int
    problem: str


class _TooLongError(BaseException):
    """The end of a command that takes too long."""


def spoil(kind: str, seed: int, right: Sequence[bytes], folder: Path) -> list[str]:
    """Write the spoiled file of a seed; the arguments of the command that reads it."""
    chance = random.Random(f"{kind} {seed}")
    content = spoiled(chance.choice(right), chance)
    if kind not in _SETTINGS:
        path = folder / f"spoiled.{kind}"
        path.write_bytes(content)
        return _reading(kind, path, folder)
    (folder / ("edge.toml" if kind == "config" else "spoiled.toml")).write_bytes(content)
    if kind == "machine":
        (folder / "edge.toml").write_text(_CONFIG)
    return ["check-config", str(folder / "edge.toml")]


def _reading(kind: str, path: Path, folder: Path) -> list[str]:
    """The command that reads a recording, or a servo tuning."""
    if kind == "tuning":
        return ["response", str(path), "--out", str(folder / "out")]
    arguments = ["convert", str(path), "--out", str(folder / "out.csv")]
    if kind == "text":
        numbered = folder / "numbered.toml"
        numbered.write_text((folder / "machine.toml").read_text() + _NUMBERED)
        arguments += ["--machine", str(numbered)]
    return arguments


def problem_of(arguments: Sequence[str]) -> str:
    """Fault of the answer of a command in this process; empty if there is none."""
    from edge_service.cli.entry import main

    said, out = io.StringIO(), io.StringIO()
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST_S)
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
            status = main(arguments)
    except _TooLongError:
        return f"took more than {LONGEST_S} s of processor time"
    except BaseException as error:  # noqa: BLE001  # whatever leaves a command is a fault
        return f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    lines = said.getvalue().splitlines()
    if status not in (DONE, BAD_INPUT):
        return f"status {status}: {lines[-1:]}"
    return f"{len(lines)} lines: {lines[:3]}" if status == BAD_INPUT and len(lines) != 1 else ""


def work(kind: str, first_seed: int, count: int) -> None:
    """Answer the files of some seeds in this process; print each seed, each fault, and the peak."""

    def end(_number: int, _frame: FrameType | None) -> None:
        raise _TooLongError

    signal.signal(signal.SIGVTALRM, end)
    resource.setrlimit(resource.RLIMIT_AS, (LIMIT_MB * 10**6, LIMIT_MB * 10**6))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for machine in (Path(__file__).parents[3] / "deploy").glob("*.toml"):
            (folder / machine.name).write_bytes(machine.read_bytes())
        right = right_files()[kind]
        problem_of(spoil(kind, 0, right, folder))  # loads what the command needs
        for seed in range(first_seed, first_seed + count):
            _say({"seed": seed})
            problem = problem_of(spoil(kind, seed, right, folder))
            if problem:
                _say({"seed": seed, "problem": problem[:300]})
    _say({"peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0})


def _say(values: dict[str, object]) -> None:
    os.write(1, json.dumps(values).encode() + b"\n")  # stdout itself belongs to the command


def run(kind: str, first_seed: int, count: int) -> tuple[list[Fault], float]:
    """Faults among the files of some seeds, and the peak of memory, MB; in a limited process."""
    worker = [sys.executable, "-m", "tests.bench.faults.files", "--work", kind]
    line = [*worker, str(first_seed), str(count)]
    ended = subprocess.run(line, capture_output=True, check=False, timeout=LIMIT_S)
    said = [json.loads(each) for each in ended.stdout.splitlines()]
    faults = [Fault(kind, each["seed"], each["problem"]) for each in said if "problem" in each]
    if ended.returncode != 0:
        seed = said[-1].get("seed", -1) if said else -1
        last = ended.stderr.decode(errors="replace").strip()[-200:]
        faults.append(Fault(kind, seed, last or f"ended with {ended.returncode}"))
    return faults, max((each["peak_mb"] for each in said if "peak_mb" in each), default=0.0)


def batches(files: int, first_seed: int) -> Iterator[tuple[str, int, int]]:
    """Kind, first seed and number of files of each process."""
    for kind in KINDS:
        of_kind = files // len(KINDS)
        for start in range(0, of_kind, FILES_AT_ONCE):
            yield kind, first_seed + start, min(FILES_AT_ONCE, of_kind - start)


def fuzz(files: int, first_seed: int) -> PipelineBench:
    """Spoil so many files of all kinds, and have each read."""
    faults: list[Fault] = []
    peak_mb, done = 0.0, Counter[str]()
    for kind, seed, count in batches(files, first_seed):
        found, memory_mb = run(kind, seed, count)
        faults += found
        peak_mb = max(peak_mb, memory_mb)
        done[kind] += count
    figures = (
        Figure("files", "hostile files", float(done.total()), ""),
        Figure("faults", "not answered by status 0 or 2", float(len(faults)), "", at_most=0.0),
        Figure("peak_mb", "peak memory", peak_mb, "MB", at_most=MOST_MEMORY_MB),
    )
    shown = tuple(f"{each.kind} {each.seed}: {each.problem}" for each in faults[:20])
    return PipelineBench(figures, (f"by kind: {dict(done)}", *shown))


@click.command()
@click.option("--files", type=click.IntRange(5), default=5000, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option("--work", type=(str, int, int), hidden=True)
def main(files: int, seed: int, work: tuple[str, int, int] | None) -> None:
    """Print how the commands answer files that were spoiled."""
    if work is not None:
        _work(*work)
        return
    click.echo(fuzz(files, seed).as_text())


_work = work

if __name__ == "__main__":
    main()
