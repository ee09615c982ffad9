"""Recordings on disk, and one job at a time in a process of its own."""

import asyncio
import contextlib
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ... import exit_status
from ...http_api.jobs import JobAnswer, JobBody, JobKind, JobState, RecordingAnswer, RefusedError
from ...http_api.times import rfc3339_s
from .job_records import forget_job, known_jobs, save_job

MOST_KEPT_BYTES = 5_000_000_000
MOST_JOBS = 20
_LINES = 40
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]{0,99}\.(csv|parquet)")
_NICE = 10

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
        self.record = self.record.model_copy(update={"ended": rfc3339_s(time.time())})


class ProcessJobDesk:
    """See JobDesk. Recordings stay in `folder`; without one everything ends with the service.

    Args:
        folder: Where recordings and answers live.
        machines: Machine file of each axis.
    """

    def __init__(
        self,
        folder: Path | None,
        machines: dict[str, Path],
        commands: dict[JobKind, JobCommand] = JOB_COMMANDS,
    ) -> None:
        root = folder or Path(tempfile.mkdtemp(prefix="edge-jobs-"))
        self._temporary = root if folder is None else None
        self._recordings, self._answers = root / "@recordings", root / "@jobs"
        self._machines = machines
        self._commands = commands
        self._jobs = {
            answer.id: _Job(answer, out, deque(answer.lines, _LINES))
            for out, answer in known_jobs(self._answers)
        }
        self._followers: set[asyncio.Task[None]] = set()

    @property
    def folder(self) -> Path:
        """Folder in which recordings are kept."""
        return self._recordings

    def recordings(self) -> list[RecordingAnswer]:
        """All recordings, newest first."""
        answers = [_recording(path) for path in self._recordings.glob("[!.]*")]
        return sorted(answers, key=lambda each: each.uploaded, reverse=True)

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> RecordingAnswer:
        """Keep a recording; whole or not at all."""
        path = self._path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if sum(each.stat().st_size for each in path.parent.iterdir()) > MOST_KEPT_BYTES:
            raise RefusedError(507, f"{MOST_KEPT_BYTES / 1e9:g} GB of recordings: remove some")
        part = path.with_name(f".{name}.part{time.monotonic_ns()}")
        size = 0
        try:
            with part.open("wb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    file.write(chunk)
            if size == 0:
                raise RefusedError(422, f"{name}: empty")
            part.replace(path)
        except OSError as error:
            raise RefusedError(507, f"{name}: cannot be kept ({error.strerror})") from None
        finally:
            part.unlink(missing_ok=True)
        return _recording(path)

    def remove(self, name: str) -> None:
        """Forget a recording."""
        self._known(name).unlink(missing_ok=True)

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
        recordings = [self._known(name) for name in body.recordings]
        baseline = None if body.baseline is None else self._fingerprint(body.baseline)
        number = max(self._jobs, default=0) + 1
        out = self._answers / f"{time.time_ns()}"
        record = JobAnswer(
            id=number,
            **body.model_dump(),
            state=JobState.RUNNING,
            started=rfc3339_s(time.time()),
            ended=None,
            lines=[],
            files=[],
        )
        job = self._jobs[number] = _Job(record, out)
        self._forget_old()
        save_job(out, job.answer())
        machine = self._machines[body.axis]
        line = self._commands[body.kind](machine, recordings, out, baseline)
        job.process = await asyncio.create_subprocess_exec(
            *line,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            start_new_session=True,
            env=os.environ | {"EDGE_SERVICE_PROGRESS": "1"},
        )
        with contextlib.suppress(OSError):  # it ended already, or priorities are not ours to set
            os.setpriority(os.PRIO_PROCESS, job.process.pid, _NICE)
        follower = asyncio.create_task(self._follow(job, job.process))
        self._followers.add(follower)
        follower.add_done_callback(self._followers.discard)
        return job.answer()

    async def cancel(self, number: int) -> JobAnswer:
        """End a job that runs."""
        job = self._job(number)
        if not job.running or job.process is None:
            state = job.record.state.value
            raise RefusedError(409, f"job {number} is {state}, it cannot be cancelled")
        job.enter(JobState.CANCELLED)
        _kill(job.process)
        await job.process.wait()
        return job.answer()

    def file(self, number: int, name: str) -> Path:
        """A file that a job made."""
        job = self._job(number)
        if name not in job.answer().files:
            raise RefusedError(404, f"job {number} made no file {name!r}")
        return job.out / name

    async def close(self) -> None:
        """End what runs; without a folder, leave nothing behind."""
        for job in self._jobs.values():
            if job.running and job.process is not None:
                _kill(job.process)
        await asyncio.gather(*self._followers, return_exceptions=True)
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    async def _follow(self, job: _Job, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            job.lines.append(line.decode(errors="replace").rstrip())
        status = await process.wait()
        job.end()
        if job.running:
            job.enter(JobState.DONE if status in _ANSWERED else JobState.FAILED)
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
            raise RefusedError(422, f"baseline: job {number} made no fingerprint")
        return job.out

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise RefusedError(
                422,
                f"{name!r}: expected letters, digits, '_', '-', '.', ending in .csv or .parquet",
            )
        return self._recordings / name

    def _known(self, name: str) -> Path:
        path = self._path(name)
        if not path.exists():
            raise RefusedError(404, f"there is no recording {name!r}")
        return path


def _recording(path: Path) -> RecordingAnswer:
    status = path.stat()
    return RecordingAnswer(name=path.name, size=status.st_size, uploaded=rfc3339_s(status.st_mtime))


def _kill(process: asyncio.subprocess.Process) -> None:
    """End the process and what it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
