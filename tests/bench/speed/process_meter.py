"""Processes of the service, started for a measurement: their time, memory and certain end."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from ..table import PipelineBenchError

STOP_PATIENCE_S = 10.0
_LOOK_PERIOD_S = 0.005
_BYTES_PER_KIB = 1024
_SERVING = re.compile(r"serving http://(\S+):(\d+)/")


@dataclass(frozen=True, slots=True)
class Usage:
    """Resources that a process has used so far.

    Attributes
    ----------
    cpu_s : float
        User and system time of all its threads, s.
    rss_bytes : int
        Resident memory now, shared libraries included.
    peak_rss_bytes : int
        The most it ever was.
    """

    cpu_s: float
    rss_bytes: int
    peak_rss_bytes: int


@dataclass(frozen=True, slots=True)
class FinishedRun:
    """A process that has ended well.

    Attributes
    ----------
    elapsed_s : float
        From start to end, s.
    cpu_s : float
        User and system time of all its threads, s.
    output : str
        What it wrote.
    """

    elapsed_s: float
    cpu_s: float
    output: str


def read_usage(pid: int) -> Usage:
    """Usage of a live process, from Linux' /proc; PipelineBenchError if there is none."""
    return Usage(_cpu_s(pid), *memory_of(_proc_text(pid, "status")))


def _cpu_s(pid: int) -> float:
    return cpu_s_of(_proc_text(pid, "stat"), _ticks_per_s())


def read_stolen_s() -> float:
    """Processor time that the host of a virtual machine gave to others since its start, s."""
    return stolen_s_of(_proc_text("stat"), _ticks_per_s())


def stolen_s_of(stat: str, ticks_per_s: int) -> float:
    """Stolen time of all processors, s, from the text of /proc/stat (eighth number)."""
    return int(stat.split(maxsplit=9)[8]) / ticks_per_s


def _ticks_per_s() -> int:
    return os.sysconf("SC_CLK_TCK")


def _proc_text(*parts: str | int) -> str:
    path = Path("/proc", *map(str, parts))
    try:
        return path.read_text()
    except OSError:
        raise PipelineBenchError(f"{path}: cannot be read; the bench needs Linux") from None


def cpu_s_of(stat: str, ticks_per_s: int) -> float:
    """User plus system time in s from the text of /proc/PID/stat (fields 14 and 15 of proc(5))."""
    behind_name = stat.rpartition(")")[2].split()  # the name may itself hold spaces and brackets
    return (int(behind_name[11]) + int(behind_name[12])) / ticks_per_s


def memory_of(status: str) -> tuple[int, int]:
    """Resident memory and its peak in bytes from the text of /proc/PID/status.

    A process that has ended has neither line; PipelineBenchError says so.
    """
    sizes = dict(re.findall(r"^(VmRSS|VmHWM):\s+(\d+) kB$", status, re.MULTILINE))
    if len(sizes) != 2:
        raise PipelineBenchError("a measured process has ended before its time")
    return int(sizes["VmRSS"]) * _BYTES_PER_KIB, int(sizes["VmHWM"]) * _BYTES_PER_KIB


class ServiceProcess:
    """`python -m edge_service ...` in a process of its own; as a context manager it always ends.

    Parameters
    ----------
    arguments : Sequence[str]
        Arguments of the command.
    folder : Path
        Its working folder; output goes to files there, so that no pipe fills up.
    kernel_cache : Path
        Where compiled kernels are kept; empty is a cold start.
    module : str
        What is run; a benchmark may prepare the service's world first.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        folder: Path,
        kernel_cache: Path,
        module: str = "edge_service",
    ) -> None:
        self._command = arguments[0]
        self._output, self._errors = folder / "stdout.txt", folder / "stderr.txt"
        with self._output.open("wb") as output, self._errors.open("wb") as errors:
            self.started_s = time.monotonic()
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                cwd=folder,
                env=os.environ | {"NUMBA_CACHE_DIR": str(kernel_cache)},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def output(self) -> str:
        """Output that it has written so far."""
        return self._output.read_text("utf-8", "replace")

    def usage(self) -> Usage:
        """Time and memory so far."""
        return read_usage(self._process.pid)

    def since_start_s(self) -> float:
        """Time since it was started, s."""
        return time.monotonic() - self.started_s

    def wait_for_address(self, patience_s: float) -> tuple[str, int]:
        """Host and port of its page, once it is served."""
        while True:
            if found := _SERVING.search(self.output):
                return found[1], int(found[2])
            if self._process.poll() is not None:
                raise self._failure("ended without serving a page")
            if self.since_start_s() > patience_s:
                raise self._failure(f"served no page within {patience_s:g} s")
            time.sleep(_LOOK_PERIOD_S)

    def wait_for_end(self, patience_s: float) -> FinishedRun:
        """Wait until it has ended with exit status 0."""
        pid, flags = self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT
        while os.waitid(os.P_PID, pid, flags) is None:
            if self.since_start_s() > patience_s:
                raise self._failure(f"did not end within {patience_s:g} s")
            time.sleep(_LOOK_PERIOD_S)
        elapsed_s, cpu_s = self.since_start_s(), _cpu_s(pid)  # /proc has it until it is waited for
        status = self._process.wait()
        if status != 0:
            raise self._failure(f"ended with exit status {status}")
        return FinishedRun(elapsed_s, cpu_s, self.output)

    def stop(self) -> None:
        """Ask it to end, then make it; safe twice."""
        if self._process.poll() is not None:
            return
        self._process.terminate()
        try:
            self._process.wait(STOP_PATIENCE_S)
        except BaseException as interruption:
            self._process.kill()
            self._process.wait()
            if not isinstance(interruption, subprocess.TimeoutExpired):
                raise

    def _failure(self, problem: str) -> PipelineBenchError:
        last = self._errors.read_text("utf-8", "replace").strip().rpartition("\n")[2]
        return PipelineBenchError(f"edge-service {self._command} {problem}: {last or 'no word'}")
