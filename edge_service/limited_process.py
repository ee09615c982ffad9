"""Processes that do what strangers' files ask for: bounded, in the background, gone with us.

The module is also their first step, `python -m edge_service.limited_process`: it bounds itself, and
becomes the command.
"""

import ctypes
import os
import resource
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass

_PR_SET_PDEATHSIG = 1
_NOBODY = 0
ENVIRONMENT = {"MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Few arenas and threads, each of which takes addresses that it does not use."""


@dataclass(frozen=True, slots=True)
class ProcessLimits:
    """Limits of one process.

    Attributes:
        memory_mb: of addresses; more is refused to it.
        cpu_s: time of all its threads; then it is killed.
        nice: how far it stands back behind others, 0 to 19.
    """

    memory_mb: float
    cpu_s: float
    nice: int = 10


def limited_command(
    command: Sequence[str], limits: ProcessLimits, *, dies_with_caller: bool
) -> list[str]:
    """The same command within limits.

    Args:
        command: program and arguments.
        limits: what it may take.
        dies_with_caller: kill it when the thread that starts it ends, however that comes about.
            Only for a thread that lives as long as the process does.
    """
    caller = os.getpid() if dies_with_caller else _NOBODY
    numbers = (caller, round(limits.memory_mb * 1e6), max(round(limits.cpu_s), 1), limits.nice)
    return [sys.executable, "-m", "edge_service.limited_process", *map(str, numbers), *command]


def why_it_ended(status: int, limits: ProcessLimits) -> str:
    """Words for the exit status of a limited process that did not end by itself; else empty."""
    if status == -signal.SIGXCPU:
        return f"it took more than {limits.cpu_s:g} s of processor time"
    if status < 0:
        return (
            f"it was ended by {signal.Signals(-status).name}, "
            f"as by a lack of memory (limit {limits.memory_mb:g} MB)"
        )
    return ""


def _bound(memory_bytes: int, cpu_s: int) -> None:
    for kind, most in (
        (resource.RLIMIT_AS, memory_bytes),
        (resource.RLIMIT_CPU, cpu_s),
        (resource.RLIMIT_CORE, 0),
    ):
        _, granted = resource.getrlimit(kind)
        least = most if granted == resource.RLIM_INFINITY else min(most, granted)
        resource.setrlimit(kind, (least, granted))


def _die_with(caller: int) -> None:
    """Let the kernel kill this process when its caller ends, or end if that has happened."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != caller:
        os._exit(1)


def main(arguments: Sequence[str]) -> None:
    """Bound this process and become the command."""
    caller, memory_bytes, cpu_s, nice = map(int, arguments[:4])
    if caller != _NOBODY:
        _die_with(caller)
    _bound(memory_bytes, cpu_s)
    os.nice(nice)
    try:
        os.execvpe(arguments[4], list(arguments[4:]), os.environ | ENVIRONMENT)
    except OSError as error:
        sys.exit(f"{arguments[4]}: cannot be run ({error.strerror})")


if __name__ == "__main__":
    main(sys.argv[1:])
