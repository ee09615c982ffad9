"""One job at a time, in a process of its own that is bounded and dies with the service."""

import asyncio
import contextlib
import os
import shutil
import signal
import sys
import tempfile
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ... import exit_status
from ...clock import now_ns
from ...config_tables import JobsConfig
from ...http_api.jobs import JobAnswer, JobBody, JobKind, JobState, RecordingAnswer, RefusedError
from ...http_api.times import rfc3339_s
from ...limited_process import ProcessLimits, limited_command, why_it_ended
from ..supervision.heartbeat import Heartbeat
from .job_records import INTERRUPTED, forget_job, known_jobs, save_job
from .recordings import Recordings

MOST_JOBS = 20
MOST_TEMPORARY_MB = 500.0
"""Of recordings where there is no folder: what is temporary may be memory."""
_LINES, _LONGEST_LINE = 40, 500
_REAP_S = 5.0

JobCommand = Callable[[Path, Sequence[Path], Path, Path | None], list[str]]
"""(machine file, recordings, folder for the answers, older answers) -> command line."""


def _edge_service(name: str) -> JobCommand:
    def command(
        machine: Path, recordings: Sequence[Path], out: Path, baseline: Path | None
    ) -> list[str]:
        line = [sys.executable, "-m", "edge_service", name, "--machine", str(machine)]
        line += ["--out", str(out), *map(str, recordings)]
        if baseline is not None:
            line += ["--baseline", str(baseline / "fingerprint.json")]
        return line

    return command


_ANSWERED = (exit_status.DONE, exit_status.BAD_DATA)
"""Exit statuses of a command that has written its answer."""

JOB_COMMANDS: dict[JobKind, JobCommand] = {
    JobKind.FINGERPRINT: _edge_service("fingerprint"),
    JobKind.DIAGNOSE: _edge_service("diagnose"),
    JobKind.DRIFT: _edge_service("drift"),
}


@dataclass(slots=True)
class _Job:
    """A job as it began or ended, with what is added while it runs."""

    record: JobAnswer
    out: Path
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_LINES))
    process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        return self.record.state is JobState.RUNNING

    def answer(self) -> JobAnswer:
        done = self.record.state is JobState.DONE
        files = sorted(path.name for path in self.out.glob("*") if path.is_file()) if done else []
        return self.record.model_copy(update={"lines": list(self.lines), "files": files})

    def enter(self, state: JobState) -> None:
        """Enter a state that ends it."""
        self.record = self.record.model_copy(update={"state": state})

    def end(self) -> None:
        """Note the time of its end."""
        self.record = self.record.model_copy(update={"ended": rfc3339_s(now_ns() / 1e9)})


class ProcessJobDesk:
    """See JobDesk. Recordings stay in `folder`; without one everything ends with the service.

    Args:
        folder: Where recordings and answers live.
        machines: Machine file of each axis.
        config: What jobs and recordings may take.
    """

    def __init__(
        self,
        folder: Path | None,
        machines: dict[str, Path],
        config: JobsConfig | None = None,
        commands: dict[JobKind, JobCommand] = JOB_COMMANDS,
    ) -> None:
        config = config or JobsConfig()
        root = folder or Path(tempfile.mkdtemp(prefix="edge-jobs-"))
        self._temporary = root if folder is None else None
        most_mb = min(config.recordings_mb, MOST_TEMPORARY_MB if folder is None else float("inf"))
        self._recordings = Recordings(root / "@recordings", round(most_mb * 1e6))
        self._answers = root / "@jobs"
        self._longest_s = config.minutes * 60.0
        cpu_s = self._longest_s * (os.cpu_count() or 1)
        self._limits = ProcessLimits(config.memory_mb, cpu_s)
        self._machines = machines
        self._commands = commands
        self._jobs = {
            answer.id: _Job(answer, out, deque(answer.lines, _LINES))
            for out, answer in known_jobs(self._answers)
        }
        self._begun: asyncio.Queue[tuple[_Job, asyncio.subprocess.Process]] = asyncio.Queue()

    @property
    def folder(self) -> Path:
        """Folder in which recordings are kept."""
        return self._recordings.folder

    def recordings(self) -> list[RecordingAnswer]:
        """All recordings, newest first."""
        return self._recordings.listed()

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> RecordingAnswer:
        """Keep a recording; whole or not at all."""
        return await self._recordings.receive(name, chunks)

    def recording(self, name: str) -> Path:
        """File of a recording."""
        return self._recordings.path(name)

    def remove(self, name: str) -> None:
        """Forget a recording."""
        self._recordings.remove(name)

    def check_free(self) -> None:
        """Refuse while a job runs."""
        if any(job.running for job in self._jobs.values()):
            raise RefusedError(409, "a job is running: wait for it, or cancel it")

    def newest(self, kind: JobKind, axis: str) -> JobAnswer | None:
        """The newest job of a kind on an axis."""
        return next((j for j in self.jobs() if (j.kind, j.axis) == (kind, axis)), None)

    def jobs(self) -> list[JobAnswer]:
        """All jobs, newest first."""
        return [job.answer() for job in reversed(self._jobs.values())]

    async def start(self, body: JobBody) -> JobAnswer:
        """Start a job; refused while another one runs."""
        self.check_free()
        recordings = [self._recordings.path(name) for name in body.recordings]
        baseline = None if body.baseline is None else self._fingerprint(body.baseline)
        number = max(self._jobs, default=0) + 1
        out = self._answers / f"{now_ns()}"
        record = JobAnswer(
            id=number,
            **body.model_dump(),
            state=JobState.RUNNING,
            started=rfc3339_s(now_ns() / 1e9),
            ended=None,
            lines=[],
            files=[],
        )
        job = self._jobs[number] = _Job(record, out)
        self._forget_old()
        save_job(out, job.answer())
        machine = self._machines[body.axis]
        line = self._commands[body.kind](machine, recordings, out, baseline)
        try:
            job.process = await _spawned(line, self._limits)
        except OSError as error:
            self._end(job, JobState.FAILED, f"cannot be started ({error.strerror})")
            raise RefusedError(503, f"job {number} {job.lines[-1]}") from None
        self._begun.put_nowait((job, job.process))
        return job.answer()

    async def run(self, heart: Heartbeat) -> None:
        """Follow the jobs that are started until cancelled, which ends a job."""
        while True:
            with heart.idle(self._begun.empty):
                job, process = await self._begun.get()
            await heart.patiently(self._follow(job, process), limit_s=self._longest_s + 2 * _REAP_S)

    async def cancel(self, number: int) -> JobAnswer:
        """End a job that runs."""
        job = self._job(number)
        if not job.running or job.process is None:
            state = job.record.state.value
            raise RefusedError(409, f"job {number} is {state} and cannot be cancelled")
        job.enter(JobState.CANCELLED)
        _kill(job.process)
        await job.process.wait()
        return job.answer()

    def file(self, number: int, name: str) -> Path:
        """A file that a job made."""
        job = self._job(number)
        if name not in job.answer().files:
            raise RefusedError(404, f"job {number} has no file {name!r}")
        return job.out / name

    async def close(self) -> None:
        """End what runs; without a folder, leave nothing behind."""
        for job in self._jobs.values():
            if job.running and job.process is not None:
                _kill(job.process)
                await job.process.wait()
                self._end(job, JobState.FAILED, INTERRUPTED)
        while not self._begun.empty():
            await _reap(self._begun.get_nowait()[1])
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    async def _follow(self, job: _Job, process: asyncio.subprocess.Process) -> None:
        state, why = JobState.FAILED, INTERRUPTED
        try:
            async with asyncio.timeout(self._longest_s):
                await _hear(process, job.lines)
                status = await process.wait()
            state = JobState.DONE if status in _ANSWERED else JobState.FAILED
            why = why_it_ended(status, self._limits)
        except TimeoutError:
            why = f"it took more than {self._longest_s / 60.0:g} minutes"
        finally:
            _kill(process)
            self._end(job, state, why)
            await _reap(process)

    def _end(self, job: _Job, state: JobState, why: str) -> None:
        """Note how it ended, unless it was cancelled."""
        job.end()
        if job.running:
            job.enter(state)
            job.lines.extend([why] if why else [])
        save_job(job.out, job.answer())

    def _forget_old(self) -> None:
        for number in sorted(self._jobs)[:-MOST_JOBS]:
            out = self._jobs.pop(number).out
            forget_job(out)
            shutil.rmtree(out, ignore_errors=True)

    def _job(self, number: int) -> _Job:
        if number not in self._jobs:
            raise RefusedError(404, f"there is no job {number}")
        return self._jobs[number]

    def _fingerprint(self, number: int) -> Path:
        job = self._job(number)
        if "fingerprint.json" not in job.answer().files:
            raise RefusedError(422, f"baseline: job {number} has no fingerprint")
        return job.out


async def _spawned(line: list[str], limits: ProcessLimits) -> asyncio.subprocess.Process:
    """A process that works in the background. Raises OSError."""
    return await asyncio.create_subprocess_exec(
        *limited_command(line, limits, dies_with_caller=True),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        start_new_session=True,
        env=os.environ | {"EDGE_SERVICE_PROGRESS": "1"},
    )


async def _hear(process: asyncio.subprocess.Process, lines: deque[str]) -> None:
    """Add what the process says, until it has no more to say; the rest of a long line is lost."""
    assert process.stdout is not None
    rest = b""
    while said := await process.stdout.read(1 << 16):
        *whole, rest = (rest + said).split(b"\n")
        lines.extend(_words(line) for line in whole[-_LINES:])
        rest = rest[:_LONGEST_LINE]
    lines.extend([_words(rest)] if rest else [])


async def _reap(process: asyncio.subprocess.Process) -> None:
    """Wait for the end of a process that was killed, and of its pipe."""
    assert process.stdout is not None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_REAP_S):
            while await process.stdout.read(1 << 16):
                pass
            await process.wait()


def _words(line: bytes) -> str:
    return line[:_LONGEST_LINE].decode(errors="replace").rstrip()


def _kill(process: asyncio.subprocess.Process) -> None:
    """End the process and what it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
