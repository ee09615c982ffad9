"""Damage of every kind of kept file: is anything wrong served, does every start work, is it told?

python -m tests.bench.faults.damage --number 3000
"""

import random
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import click

from ..table import Figure, PipelineBench
from . import kept
from .answers import Answers, ask, differing
from .scene import running_service

AXES = ("A1", "A2", "A3", "A4")
_UNTOUCHED = AXES[-1]
_RECORD_BYTES = 69
_NAMING_PATIENCE_S, _LOOK_PERIOD_S = 15.0, 0.5
Spoiler = Callable[[Path, random.Random], None]


def flip(path: Path, rng: random.Random) -> None:
    """Flip one bit."""
    content = bytearray(path.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def cut(path: Path, rng: random.Random) -> None:
    """Cut it off, within a record where it has records: between two nobody could tell."""
    length = rng.randrange(1, path.stat().st_size)
    path.write_bytes(path.read_bytes()[: length + (length % _RECORD_BYTES == 0)])


def zero(path: Path, rng: random.Random) -> None:
    """Fill a sector with zeros."""
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content)) // 512 * 512
    content[start : start + 512] = bytes(len(content[start : start + 512]))
    path.write_bytes(content)


def garble(path: Path, rng: random.Random) -> None:
    """Replace all from somewhere on."""
    content = path.read_bytes()
    start = rng.randrange(len(content))
    path.write_bytes(content[:start] + rng.randbytes(min(600, len(content) - start)))


def empty(path: Path, _: random.Random) -> None:
    """Leave a file of no length; a log, which may be empty, gets a byte."""
    path.write_bytes(b"\0" if path.suffix == ".log" else b"")


def folder(path: Path, _: random.Random) -> None:
    """Put a folder in its place."""
    path.unlink()
    path.mkdir()


def loop(path: Path, _: random.Random) -> None:
    """Put a link to itself in its place: it can be read by nobody."""
    path.unlink()
    path.symlink_to(path.name)


SPOILERS: tuple[Spoiler, ...] = (flip, flip, flip, cut, zero, garble, empty, folder, loop)


@dataclass(slots=True)
class Toll:
    """Outcome of many damages."""

    damages: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    blocked: list[str] = field(default_factory=list)
    served: list[str] = field(default_factory=list)
    disturbed: list[str] = field(default_factory=list)
    unnamed: Counter[str] = field(default_factory=Counter)

    def paths(self) -> Counter[str]:
        """Wrong answers by the path within the answer."""
        return Counter(each.partition(": ")[0].partition(" ")[2] for each in self.served)


@dataclass(frozen=True, slots=True)
class Truth:
    """Answers with which those on a damaged folder are compared.

    Attributes:
        whole: on the undamaged folder.
        nothing: on an empty one.
        free: paths of answers that differ anyway, by axis.
    """

    until_s: float
    whole: dict[str, Answers]
    nothing: dict[str, Answers]
    free: dict[str, frozenset[str]]


def truth_of(base: Path, work: Path) -> Truth:
    """Ask a service on copies of the folder, twice, and one on an empty folder."""
    until_s = time.time()
    runs = []
    for number, source in enumerate((base, base, None)):
        history = work / f"truth_{number}"
        if source is not None:
            shutil.copytree(source, history)
        runs.append(_asked(history, work, until_s)[0])
    one, other, nothing = runs
    free = {axis: differing(one[axis], other[axis]) for axis in AXES}
    return Truth(until_s, one, nothing, free)


def _asked(
    history: Path, work: Path, until_s: float, damaged: list[str] | None = None
) -> tuple[dict[str, Answers], str]:
    """Answers and log of a service on a folder; it has some time to name the damaged files."""
    with running_service(kept.unreachable(AXES, history), work) as service:
        answers = ask(service, AXES, until_s)
        patient_s = time.monotonic() + _NAMING_PATIENCE_S
        while True:
            said = service.errors.read_text("utf-8")
            named = all(name in said for name in damaged or ())
            if named or time.monotonic() > patient_s:
                return answers, said
            time.sleep(_LOOK_PERIOD_S)


def spoil(history: Path, rng: random.Random) -> dict[Path, str]:
    """Damage every file but those of one axis; what was done to each, if it changed anything.

    A bit of a database in which nothing is kept can be another without any harm.
    """
    done = {}
    for path in kept.files(history):
        if f"axis={_UNTOUCHED}" in path.parts:
            continue
        how = rng.choice(SPOILERS)
        if not (history / path).stat().st_size:
            continue
        place = history / path
        held = kept.content(place)
        how(place, rng)
        if place.is_symlink() or place.is_dir() or kept.content(place) != held:
            done[path] = how.__name__
    return done


def one_round(base: Path, work: Path, truth: Truth, rng: random.Random, toll: Toll) -> None:
    """Start a service on a damaged folder and judge it."""
    history = work / "damaged"
    shutil.rmtree(history, ignore_errors=True)
    shutil.copytree(base, history)
    done = spoil(history, rng)
    toll.damages += len(done)
    toll.kinds.update(map(kept.kind, done))
    try:
        answers, said = _asked(history, work, truth.until_s, [path.name for path in done])
    except Exception as error:  # noqa: BLE001 - whatever stops the start is the finding
        toll.blocked.append(f"{error} {[(str(path), how) for path, how in done.items()]}")
        return
    _judge(answers, truth, toll)
    for path, how in done.items():
        if path.name not in said and str(history / path) not in said:
            toll.unnamed[f"{kept.kind(path)} {how}"] += 1


def _judge(answers: dict[str, Answers], truth: Truth, toll: Toll) -> None:
    for axis, found in answers.items():
        whole, nothing = truth.whole[axis], truth.nothing[axis]
        false = found.false_ones(whole, nothing, truth.free[axis], truth.until_s)
        toll.served += [f"{axis} {path}: {value[:200]}" for path, value in false]
    sound, found = truth.whole[_UNTOUCHED], answers[_UNTOUCHED]
    if found.buckets != sound.buckets:
        toll.disturbed.append("history")


def damage(work: Path, number: int, seed: int = 1, hours: int = 4) -> PipelineBench:
    """Damage kept files until so many damages are done."""
    rng, toll = random.Random(seed), Toll()
    base = kept.keep(work, AXES, hours)
    truth = truth_of(base, work)
    while toll.damages < number:
        one_round(base, work, truth, rng, toll)
    figures = (
        Figure("damages", "damages", float(toll.damages), ""),
        Figure("kinds", "kinds of files", float(len(toll.kinds)), ""),
        Figure("served", "wrong answers", float(len(toll.served)), "", at_most=0.0),
        Figure("blocked", "starts blocked", float(len(toll.blocked)), "", at_most=0.0),
        Figure("unnamed", "damages not named", float(toll.unnamed.total()), "", at_most=0.0),
        Figure("disturbed", "other axes disturbed", float(len(toll.disturbed)), "", at_most=0.0),
    )
    notes = [f"{name}: {count}" for name, count in sorted(toll.kinds.items())]
    notes += [f"not named: {name}: {count}" for name, count in toll.unnamed.most_common(12)]
    notes += [f"wrong: {path}: {count}" for path, count in toll.paths().most_common(12)]
    notes += [*toll.served[:4], *toll.blocked[:4]]
    return PipelineBench(figures, tuple(notes))


@click.command()
@click.option("--number", type=click.IntRange(1), default=3000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def main(number: int, seed: int) -> None:
    """Print what becomes of damaged files that a service finds at its start."""
    with tempfile.TemporaryDirectory() as name:
        click.echo(damage(Path(name), number, seed).as_text())


if __name__ == "__main__":
    main()
