"""Keeping, killed on entering every system call that changes a file: a process forked for each.

strace does the killing, so the calls of SQLite are among them.
"""

import json
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from edge_service.atomic import read_checked, write_checked
from edge_service.health.events.diary import Diary
from edge_service.health.history.archive import AxisArchive
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event, Severity

CALLS = "write,pwrite64,writev,pwritev,fsync,fdatasync,rename,renameat,renameat2,unlink,unlinkat"
CALLS += ",ftruncate,truncate,link,linkat,mkdir,mkdirat"
AXES = ("A1", "A2")
_START_S = 1_769_817_600.0
_STEP_S, _TURNS, _PER_TURN = 120.0, 9, 8
_NS = 1_000_000_000
_LOOK_PERIOD_S = 0.002


@dataclass(frozen=True, slots=True)
class Loss:
    """Outcome of one death: what was acknowledged and is missing, and what is there twice."""

    lost: int
    doubled: int
    damages: int


def work(folder: Path, seed: int, acknowledge: int) -> None:
    """Keep estimates, events and a state in turns; say on a pipe what is on the disk.

    Args:
        acknowledge: descriptor of the pipe.
    """
    rng = random.Random(seed)
    archives = {axis: AxisArchive(folder / f"axis={axis}") for axis in AXES}
    diary = Diary(folder / "@diary.sqlite")
    number = 0
    for turn in range(_TURNS):
        for _ in range(rng.randrange(_PER_TURN // 2, 2 * _PER_TURN)):
            for archive in archives.values():
                archive.append(round((_START_S + number * _STEP_S) * _NS), _estimate(number))
            number += 1
        for archive in archives.values():
            archive.flush(sync=True)
        diary.add([_note(turn)], (turn + 1) * _NS)
        write_checked(folder / "state.json", json.dumps({"turn": turn}))
        os.write(acknowledge, f"{turn} {number}\n".encode())


def _estimate(number: int) -> PreloadEstimate:
    status = EstimateStatus.ESTIMATED
    return PreloadEstimate(time_s=0.0, status=status, preload_percent=float(number + 1))


def _note(turn: int) -> Event:
    return Event(
        axis="A1", kind="note", severity=Severity.INFO, message=f"note {turn}", time_ns=turn + 1
    )


def die_at(folder: Path, seed: int, call: int) -> tuple[Loss, bool]:
    """Kill a process on entering a call; what was lost, and whether it came so far."""
    folder.mkdir()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.kill(os.getpid(), signal.SIGSTOP)
        work(folder, seed, writing)
        os._exit(0)
    os.close(writing)
    os.waitpid(child, os.WUNTRACED)
    with _Killer(child, call):
        os.kill(child, signal.SIGCONT)
        acknowledged = b"".join(iter(lambda: os.read(reading, 4096), b""))
        status = os.waitpid(child, 0)[1]
    os.close(reading)
    return loss(folder, acknowledged.decode()), os.WIFSIGNALED(status)


class _Killer:
    """`strace` that kills a process on entering a call; inside it is attached."""

    def __init__(self, pid: int, call: int) -> None:
        self._pid, self._call = pid, call

    def __enter__(self) -> None:
        inject = f"inject={CALLS}:signal=KILL:when={self._call}"
        command = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={CALLS}", "-e", inject]
        self._process = subprocess.Popen([*command, "-p", str(self._pid)])
        while "TracerPid:\t0\n" in Path(f"/proc/{self._pid}/status").read_text():
            if self._process.poll() is not None:
                os.kill(self._pid, signal.SIGKILL)
                raise click.ClickException("strace cannot attach to a process here")
            time.sleep(_LOOK_PERIOD_S)

    def __exit__(self, *_: object) -> None:
        self._process.wait()


def loss(folder: Path, acknowledged: str) -> Loss:
    """Comparison of what a folder keeps with what was acknowledged."""
    *_, (turn, number) = [(-1, 0), *_acknowledged(acknowledged)]
    lost = doubled = damages = 0
    for axis in AXES:
        archive = AxisArchive(folder / f"axis={axis}")
        for step_s in (1.0, 60.0, 3600.0):
            rows = archive.rows(0.0, 1e10, step_s)
            samples = int(rows.samples.sum())
            lost += max(number - samples, 0)
            doubled += len(rows) - np.unique(rows.time_s).size
            doubled += max(samples - len(archive.rows(0.0, 1e10, 1.0)), 0) if step_s > 1.0 else 0
        archive.flush(sync=True)
        damages += sum("torn" not in words for words in archive.take_damages())
    diary = Diary(folder / "@diary.sqlite")
    notes = [each.event.message for each in diary.between(0, 10**12, "A1", 1000)]
    diary.close()
    lost += len({f"note {each}" for each in range(turn + 1)} - set(notes))
    doubled += len(notes) - len(set(notes))
    state = read_checked(folder / "state.json")
    lost += (-1 if state is None else json.loads(state)["turn"]) < turn
    return Loss(lost, doubled, damages)


def _acknowledged(text: str) -> Iterator[tuple[int, int]]:
    for line in text.splitlines():
        turn, number = line.split()
        yield int(turn), int(number)


def every_call(work_folder: Path, number: int) -> list[Loss]:
    """Die at call after call, and begin again with other work when it came to its end."""
    losses: list[Loss] = []
    seed, call = 0, 1
    while len(losses) < number:
        found, killed = die_at(work_folder / f"{seed}_{call}", seed, call)
        losses.append(found)
        seed, call = (seed, call + 1) if killed else (seed + 1, 1)
    return losses
