"""A disk that is full, read-only or out of descriptors for a while: what goes on, what is kept?

python -m tests.bench.faults.disk            # needs the right to mount a small tmpfs
"""

import io
import os
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..table import Figure, PipelineBench
from .kept import shifted
from .scene import RunningService, configuration, running_service

AXES = ("A1", "A2")
_CLOCK = "tests.bench.faults.shifted_clock"
_SIZE_MB = 8
_BEFORE_S, _FAULT_S, _AFTER_S = 6.0, 10.0, 8.0
_LOOK_PERIOD_S = 0.1
_PATIENCE_S = 30.0
MOST_RECOVERY_S = 5.0
Change = Callable[["Disk", int], None]


@dataclass(frozen=True, slots=True)
class Disk:
    """A small disk of its own."""

    folder: Path

    @property
    def _filler(self) -> Path:
        return self.folder / "filler"

    def fill(self, _pid: int = 0) -> None:
        """Leave no byte."""
        for size in (1 << 16, 1):
            with self._filler.open("ab", buffering=0) as file:
                try:
                    while file.write(b"x" * size) == size:
                        pass
                except OSError:
                    continue

    def empty(self, _pid: int = 0) -> None:
        """Give the space back."""
        self._filler.unlink(missing_ok=True)

    def read_only(self, _pid: int = 0) -> None:
        """Let nothing more be opened for writing; what is open stays so."""
        _mount("--bind", str(self.folder), str(self.folder))
        _mount("-o", "remount,bind,ro", str(self.folder))

    def writable(self, _pid: int = 0) -> None:
        """Let it be written again."""
        _unmount(self.folder)


def no_growth(_: Disk, pid: int) -> None:
    """Let no file of a process grow."""
    most = resource.prlimit(pid, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, most))


def growth(_: Disk, pid: int) -> None:
    """Let them grow again."""
    most = resource.prlimit(pid, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, most))


def no_descriptors(_: Disk, pid: int) -> None:
    """Let a process open nothing more."""
    _limit_descriptors(pid, max(int(each.name) for each in Path(f"/proc/{pid}/fd").iterdir()) + 1)


def descriptors(_: Disk, pid: int) -> None:
    """Let it again."""
    _limit_descriptors(pid, resource.prlimit(pid, resource.RLIMIT_NOFILE)[1])


def _limit_descriptors(pid: int, number: int) -> None:
    most = resource.prlimit(pid, resource.RLIMIT_NOFILE)[1]
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (number, most))


def _mount(*arguments: str) -> None:
    done = subprocess.run(["mount", *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise click.ClickException(f"a tmpfs cannot be mounted here: {done.stderr.strip()}")


def _unmount(folder: Path) -> None:
    subprocess.run(["umount", "-l", str(folder)], check=True)


@contextmanager
def small_disk(folder: Path) -> Iterator[Disk]:
    """A disk of some megabytes, for as long as the context lasts."""
    folder.mkdir()
    _mount("-t", "tmpfs", "-o", f"size={_SIZE_MB}m", "tmpfs", str(folder))
    try:
        yield Disk(folder)
    finally:
        _unmount(folder)


@dataclass(frozen=True, slots=True)
class Case:
    """One way in which a disk fails, and is well again.

    Attributes:
        at_start: it fails before the service starts.
        at_hour: an hour ends while it fails.
        asks: whether the service can answer meanwhile.
        mounts: it takes a disk of its own.
    """

    name: str
    fail: Change
    mend: Change
    at_start: bool = False
    at_hour: bool = False
    asks: bool = True
    mounts: bool = True


CASES = (
    Case("full", Disk.fill, Disk.empty),
    Case("full at the hour", Disk.fill, Disk.empty, at_hour=True),
    Case("full at the start", Disk.fill, Disk.empty, at_start=True),
    Case("read-only", Disk.read_only, Disk.writable),
    Case("read-only at the hour", Disk.read_only, Disk.writable, at_hour=True),
    Case("read-only at the start", Disk.read_only, Disk.writable, at_start=True),
    Case("no growth", no_growth, growth, mounts=False),
    Case("no descriptors", no_descriptors, descriptors, asks=False, mounts=False),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one case.

    Attributes:
        told: the component `history` was in error meanwhile.
        answers_down: looks at which an axis had no fresh estimate meanwhile.
        recovery_s: from relief to a history that is kept.
        heard: estimates that the service had heard before, during and after the fault.
        lost: those that are missing after a restart.
        doubled: those that are kept twice.
    """

    name: str
    told: bool
    answers_down: int
    recovery_s: float
    heard: int
    lost: int
    doubled: int


def disk_of(case: Case, folder: Path) -> AbstractContextManager[Disk]:
    """The disk that a case needs."""
    return small_disk(folder) if case.mounts else nullcontext(Disk(folder))


def run_case(case: Case, work: Path) -> Outcome:
    """Let a disk fail under a service, mend it, and see what is kept after a restart."""
    work.mkdir()
    clock = work / "clock"
    hour_s = time.time() // 3600.0 * 3600.0
    start_s = hour_s - _BEFORE_S - _FAULT_S / 2.0 if case.at_hour else hour_s + 60.0
    with disk_of(case, work / "disk") as disk, shifted(clock, start_s):
        config = configuration(AXES, folder=disk.folder / "history")
        if case.at_start:
            case.fail(disk, 0)
        with running_service(config, work, _CLOCK) as service:
            service.wait_ready()
            begun_s = time.time() + float(clock.read_text())
            told, down, recovery_s = _fault(case, disk, service)
            time.sleep(_AFTER_S)
            span_s = begun_s, time.time() + float(clock.read_text()) - 1.0
            heard = [_times(service, axis, *span_s) for axis in AXES]
        with running_service(config, work, _CLOCK) as service:
            kept = [_times(service, axis, *span_s) for axis in AXES]
    doubled = sum(times.size - np.unique(times).size for times in kept)
    lost = sum(np.setdiff1d(*each).size for each in zip(heard, kept, strict=True))
    return Outcome(
        case.name, told, down, recovery_s, sum(each.size for each in heard), lost, doubled
    )


def _fault(case: Case, disk: Disk, service: RunningService) -> tuple[bool, int, float]:
    """Fail, look on, mend, wait until the history is well."""
    told, down = False, 0
    if not case.at_start:
        time.sleep(_BEFORE_S)
        case.fail(disk, service.pid)
    until_s = time.monotonic() + _FAULT_S
    while time.monotonic() < until_s:
        time.sleep(10.0 * _LOOK_PERIOD_S)
        if case.asks:
            told |= _status(service) == "recoverable_error"
            down += not service.is_ready()
    case.mend(disk, service.pid)
    mended_s = time.monotonic()
    while _status(service) != "ok":
        time.sleep(_LOOK_PERIOD_S)
        if time.monotonic() - mended_s > _PATIENCE_S:
            return told, down, float("inf")
    return told, down, time.monotonic() - mended_s


def _status(service: RunningService) -> str:
    try:
        components = service.ask("/api/v1/health").json["components"]
    except OSError:
        return "gone"
    found = [each["status"] for each in components if each["component"] == "history"]
    return str(found[0]) if found else "absent"


def _times(service: RunningService, axis: str, start_s: float, end_s: float) -> Any:
    """UNIX times of the estimates kept in a span, s."""
    import pyarrow.parquet as pq

    answer = service.ask(f"/api/v1/axes/{axis}/history.parquet?from={start_s}&to={end_s}")
    table = pq.read_table(io.BytesIO(answer.body))
    return table.column("time").cast("int64").to_numpy() / 1e6


def disk_faults(work: Path, cases: tuple[Case, ...] = CASES) -> PipelineBench:
    """Run all cases."""
    outcomes = [run_case(case, work / case.name.replace(" ", "_")) for case in cases]
    asked = [each for each, case in zip(outcomes, cases, strict=True) if case.asks]
    slowest_s = max(each.recovery_s for each in outcomes)
    figures = (
        Figure("cases", "ways of failing", float(len(outcomes)), ""),
        Figure("untold", "not told", float(sum(not e.told for e in asked)), "", at_most=0.0),
        Figure("down", "not ready", float(sum(e.answers_down for e in asked)), "", at_most=0.0),
        Figure("recovery_s", "slowest recovery", slowest_s, "s", at_most=MOST_RECOVERY_S),
        Figure("heard", "estimates", float(sum(e.heard for e in outcomes)), ""),
        Figure("lost", "lost", float(sum(e.lost for e in outcomes)), "", at_most=0.0),
        Figure("doubled", "doubled", float(sum(e.doubled for e in outcomes)), "", at_most=0.0),
    )
    return PipelineBench(figures, tuple(str(outcome) for outcome in outcomes))


@click.command()
@click.option("--only", help="Part of the names of the cases.", default="")
def main(only: str) -> None:
    """Print what a service keeps, and how soon it recovers, when its disk fails for a while."""
    if os.geteuid() != 0:
        click.echo("mounting may need root", err=True)
    cases = tuple(case for case in CASES if only in case.name)
    with tempfile.TemporaryDirectory() as name:
        click.echo(disk_faults(Path(name), cases).as_text())


if __name__ == "__main__":
    main()
