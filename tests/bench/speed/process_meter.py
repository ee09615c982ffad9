"""Processes of the service, started for a measurement: their time, memory and certain end."""

import http.client
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from edge_service.process import ENVIRONMENT

from ..table import BenchError

PATIENCE_S, STOP_PATIENCE_S, _TIMEOUT_S = 120.0, 10.0, 10.0
_LOOK_PERIOD_S = 0.005
_SERVING = re.compile(r"serving http://(\S+):(\d+)/")


@dataclass(frozen=True, slots=True)
class Usage:
    """Resources that a process has used so far, with all that it has started."""

    cpu_s: float  # of all that live, and of those that they have waited for, s
    # own_mb, peak_mb: resident memory of the process itself, now and at most, MB
    own_mb: float
    peak_mb: float
    shared_mb: float  # proportional set size of all, MB: what two share counts half in each


def usage_of(pid: int) -> Usage:
    """Resources now, from Linux' /proc."""
    pids, status = _tree(pid), Path(f"/proc/{pid}/status")
    shared = sum(_mb(Path(f"/proc/{each}/smaps_rollup"), "Pss") for each in pids)
    return Usage(sum(map(cpu_s, pids)), _mb(status, "VmRSS"), _mb(status, "VmHWM"), shared)


def _tree(pid: int) -> list[int]:
    found = [pid]
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in _text(task / "children").split():
            found += _tree(int(child))
    return found


def cpu_s(pid: int) -> float:
    """User and system time of a process and of its children that have ended, s."""
    fields = _text(Path(f"/proc/{pid}/stat")).rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def read_stolen_s() -> float:
    """Processor time that the host of a virtual machine gave to others since its start, s."""
    return int(_text(Path("/proc/stat")).split(maxsplit=9)[8]) / os.sysconf("SC_CLK_TCK")


def _mb(path: Path, name: str) -> float:
    found = re.search(rf"^{name}:\s+(\d+) kB$", _text(path), re.MULTILINE)
    return int(found[1]) * 1024 / 1e6 if found else 0.0


def _text(path: Path) -> str:
    """Content of a file of /proc; empty where its process has ended meanwhile."""
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


def get(host: str, port: int, path: str) -> tuple[int, bytes]:
    with closing(http.client.HTTPConnection(host, port, timeout=_TIMEOUT_S)) as connection:
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read()


def wait_until(holds: Callable[[], bool], problem: str, period_s: float = 0.1) -> None:
    """Look again and again; BenchError with the problem where it does not hold in two minutes."""
    until_s = time.monotonic() + PATIENCE_S
    while not holds():
        if time.monotonic() > until_s:
            raise BenchError(problem)
        time.sleep(period_s)


def kept_in(folder: Path) -> dict[str, str]:
    """Environment that keeps kernels and bytecode, as an installation does, and ends with us."""
    kept = {"NUMBA_CACHE_DIR": str(folder), "PYTHONPYCACHEPREFIX": f"{folder}/bytecode"}
    return ENVIRONMENT | kept | {"PYTHONDONTWRITEBYTECODE": ""}


class Program:
    """A program that is told lines and says lines; as a context manager it always ends."""

    def __init__(self, *line: str) -> None:
        self._process = subprocess.Popen(
            line,
            cwd=Path(__file__).parents[3],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def hear(self) -> str:
        """Its next line; empty where it has ended."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()


class ServiceProcess:
    """`python -m edge_service ...` in a process of its own; as a context manager it always ends.

    Args:
        folder: its working folder; output goes to files there, so that no pipe fills up.
        kernel_cache: where compiled code is kept; empty is a cold start.
    """

    def __init__(self, arguments: Sequence[str], folder: Path, kernel_cache: Path) -> None:
        self._command = arguments[0]
        self._output, self._errors = folder / "stdout.txt", folder / "stderr.txt"
        with self._output.open("wb") as output, self._errors.open("wb") as errors:
            self.started_s = time.monotonic()
            self._process = subprocess.Popen(
                [sys.executable, "-m", "edge_service", *arguments],
                cwd=folder,
                env=os.environ | kept_in(kernel_cache),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
            )
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def output(self) -> str:
        return self._output.read_text("utf-8", "replace")

    def since_start_s(self) -> float:
        return time.monotonic() - self.started_s

    def wait_for_address(self, patience_s: float = PATIENCE_S) -> tuple[str, int]:
        """Host and port of its page, once it is served."""
        while True:
            if found := _SERVING.search(self.output):
                return found[1], int(found[2])
            if self._process.poll() is not None:
                raise self._failure("ended without serving a page")
            if self.since_start_s() > patience_s:
                raise self._failure(f"served no page within {patience_s:g} s")
            time.sleep(_LOOK_PERIOD_S)

    def wait_for_end(self, patience_s: float) -> tuple[float, str]:
        """Processor time, s, and output, once it has ended with exit status 0."""
        flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
        while os.waitid(os.P_PID, self.pid, flags) is None:
            if self.since_start_s() > patience_s:
                raise self._failure(f"did not end within {patience_s:g} s")
            time.sleep(_LOOK_PERIOD_S)
        spent_s = cpu_s(self.pid)  # /proc has it until it is waited for
        if (status := self._process.wait()) != 0:
            raise self._failure(f"ended with exit status {status}")
        return spent_s, self.output

    def stop(self) -> None:
        """Ask it to end, then make it; safe twice."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(STOP_PATIENCE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _failure(self, problem: str) -> BenchError:
        last = self._errors.read_text("utf-8", "replace").strip().rpartition("\n")[2]
        return BenchError(f"edge-service {self._command} {problem}: {last or 'no word'}")
