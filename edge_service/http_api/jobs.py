"""Jobs: commands that run beside the service, each one process, one row and one folder."""

import asyncio
import json
import re
import shutil
import sqlite3
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Self

from pydantic import ConfigDict, Field, ValidationError, model_validator

from .. import exit_status, process
from ..atomic import append, made_folder, new_file
from ..clock import now_ns
from ..health.store.store import Store, StoreFailedError
from ..messages.interval import rfc3339
from ..threads import Threads
from .answers import Answer, Timestamp
from .problems import RefusedError
from .recordings import RecordingName, Recordings

SCHEMA = """
CREATE TABLE IF NOT EXISTS jobs (id INTEGER PRIMARY KEY AUTOINCREMENT, body TEXT NOT NULL)
"""
MOST_AT_ONCE = 2
"""So that an axis is recorded while the recording before is diagnosed."""
MOST_KEPT = 20
LONGEST_S = 3600.0
_MOTION_LIMIT_S = 120.0
LOG, ANSWER = "log.txt", "answer.json"
_LINES, _TAIL_BYTES = 40, 8192
_PROGRESS = re.compile(
    r"edge-service [a-z-]+: (?P<stage>.+?)(, (?P<percent>\d+) %)?(, (?P<elapsed_s>[\d.]+) s)?"
)


class JobCommand(StrEnum):
    """Command of a job."""

    RECORD = "record"
    ADOPT = "adopt"
    DOCTOR = "doctor"
    COMMISSION = "commission"
    FINGERPRINT = "fingerprint"
    DIAGNOSE = "diagnose"


_OUT = {
    JobCommand.ADOPT: "machine.toml",
    JobCommand.COMMISSION: "commissioned.toml",
    JobCommand.FINGERPRINT: "",
    JobCommand.DIAGNOSE: "",
}
"""File that a command writes into the job's folder; empty: it fills the folder itself."""
_ANSWERED = {
    JobCommand.DOCTOR: (exit_status.DONE, exit_status.INTERNAL_FAILURE),
    JobCommand.DIAGNOSE: (exit_status.DONE, exit_status.BAD_DATA),
}
"""Exit statuses with an answer, where there are more than one."""


class JobState(StrEnum):
    """State of a job; `interrupted`: the service ended while it ran."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"


class JobOptions(Answer):
    """Options of a job's command."""

    duration_s: float | None = Field(
        None, gt=0.0, le=LONGEST_S, allow_inf_nan=False, description="Of `record`, s."
    )
    baseline: int | None = Field(None, description="Of `fingerprint`: job with an older one.")


class JobBody(Answer):
    """Request for a job."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"command": "fingerprint", "axis": "X", "recordings": ["friction.csv"]}]
        }
    )

    command: JobCommand
    axis: str
    recordings: list[RecordingName] = Field(
        [], max_length=50, description="What it examines; of `record`, the name that it writes."
    )
    options: JobOptions = JobOptions()

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.command is JobCommand.RECORD:
            if self.options.duration_s is None or len(self.recordings) > 1:
                raise ValueError("record: expected options.duration_s, and at most one recording")
        elif not self.recordings:
            raise ValueError(f"recordings: {self.command} needs one at least")
        return self


class Job(JobBody):
    """Row of a job."""

    model_config = ConfigDict(json_schema_extra={"examples": []})

    state: JobState
    started: Timestamp
    ended: Timestamp | None = None


class JobAnswer(Job):
    """One job."""

    id: int
    stage: str = Field(description="What it does now.")
    share: float | None = Field(description="Part that is done, 0 to 1; null: unknown.")
    left_s: float | None = Field(description="Time that it may still take, s; null: unknown.")
    lines: list[str] = Field(description="The last lines of its log.")
    files: list[str] = Field(description="What it has made so far.")
    verdict: str | None = Field(
        description="What its answer says in a word or a sentence, or its error."
    )


class JobsAnswer(Answer):
    """All jobs, newest first."""

    items: list[JobAnswer]
    next: str | None = Field(None, description="Address of older ones; null: there are none.")


class Jobs:
    """Jobs of one service. Every call may raise RefusedError, StoreFailedError.

    Args:
        folder: of the jobs' own folders.
        machines: machine file of each axis.
        service: arguments by which a command reaches this service.
    """

    def __init__(
        self,
        store: Store,
        folder: Path,
        recordings: Recordings,
        machines: dict[str, Path],
        service: tuple[str, ...] = (),
    ) -> None:
        self._store, self._folder, self._recordings = store, folder, recordings
        self._machines, self._service = machines, service
        self._running: dict[int, asyncio.subprocess.Process] = {}
        self._following: dict[int, asyncio.Task[None]] = {}
        self._cancelled: set[int] = set()
        self._one = asyncio.Lock()
        self._threads = Threads("job")
        store.define(SCHEMA)

    async def all(self) -> list[JobAnswer]:
        """All jobs, newest first."""
        wanted = "SELECT id, body FROM jobs ORDER BY id DESC LIMIT ?"

        def rows(file: sqlite3.Connection) -> list[tuple[int, str]]:
            return file.execute(wanted, (MOST_KEPT,)).fetchall()

        answers = []
        for number, body in await self._store.run(self._store.read, rows):
            with suppress(ValidationError):  # damage in the file: what is left of it is not shown
                answers.append(self._answer(number, Job.model_validate_json(body)))
        return answers

    async def get(self, number: int) -> JobAnswer:
        """One job."""
        found = next((job for job in await self.all() if job.id == number), None)
        if found is None:
            raise RefusedError(404, f"there is no job {number}")
        return found

    async def start(self, body: JobBody) -> JobAnswer:
        """Start a job; refused while as many run as may."""
        async with self._one:
            if len(self._running) >= MOST_AT_ONCE:
                raise RefusedError(409, f"{MOST_AT_ONCE} jobs are running: wait, or cancel one")
            words = await self._words(body)
            job = Job(**body.model_dump(), state=JobState.RUNNING, started=rfc3339(now_ns()))
            number = await self._put(None, job)
            folder = self._folder / str(number)
            out = _OUT.get(body.command)
            words += () if out is None else ("--out", str(folder / out))
            try:
                await self._threads.run(shutil.rmtree, folder, ignore_errors=True)
                made_folder(folder)
                with new_file(folder / LOG) as log, new_file(folder / ANSWER) as answer:
                    started = await process.started(*words, stdout=answer, stderr=log)
            except OSError as error:
                await self._put(number, job.model_copy(update={"state": JobState.FAILED}))
                raise RefusedError(
                    503, f"job {number} cannot be started ({error.strerror})"
                ) from None
            self._running[number] = started
            self._following[number] = asyncio.create_task(self._follow(number, job, started))
            await self._forget_old()
            return self._answer(number, job)

    async def cancel(self, number: int) -> JobAnswer:
        """End a job that runs; a recording keeps what there is."""
        if number not in self._running:
            job = await self.get(number)
            raise RefusedError(409, f"job {number} is {job.state.value} and cannot be cancelled")
        self._cancelled.add(number)
        await process.end(self._running[number])
        await asyncio.wait([self._following[number]])
        return await self.get(number)

    async def file(self, number: int, name: str) -> Path:
        """A file that a job made."""
        if name not in (await self.get(number)).files:
            raise RefusedError(404, f"job {number} has no file {name!r}")
        return self._folder / str(number) / name

    async def motion(self, axis: str, name: str, form: str) -> bytes:
        """File of a motion for the controller, as the command `motion` writes it."""
        with tempfile.TemporaryDirectory(prefix="edge-motion-") as folder:
            out = Path(folder) / f"motion.{form}"
            words = ("motion", name, "--machine", str(self._machines[axis]), "--out", str(out))
            try:
                status, said = await process.finished(*words, limit_s=_MOTION_LIMIT_S)
            except (OSError, TimeoutError) as error:
                raise RefusedError(503, f"motion {name!r} cannot be written: {error}") from None
            if status != exit_status.DONE:
                raise RefusedError(409, said or f"it cannot be written (status {status})")
            return await self._threads.run(out.read_bytes)

    async def close(self) -> None:
        """End what runs."""
        following = [*self._following.values()]
        for task in following:
            task.cancel()
        if following:
            await asyncio.wait(following)

    async def _words(self, body: JobBody) -> tuple[str, ...]:
        """Arguments of a command, without --out of what it writes into its folder."""
        options = body.options
        words: tuple[str, ...] = (body.command.value, "--json")
        if body.command is JobCommand.RECORD:
            now = datetime.fromtimestamp(now_ns() / 1e9, UTC)
            names = body.recordings or [f"{body.axis}_{now:%Y%m%dT%H%M%SZ}.parquet"]
            out = self._recordings.place(names[0])
            words += ("--axis", body.axis, "--duration", f"{options.duration_s}")
            return (*words, "--out", str(out), *self._service)
        paths = [str(self._recordings.path(name)) for name in body.recordings]
        if body.command is not JobCommand.ADOPT:
            words += ("--machine", str(self._machines[body.axis]))
        if options.baseline is not None and body.command is JobCommand.FINGERPRINT:
            baseline = await self.file(options.baseline, "fingerprint.json")
            words += ("--baseline", str(baseline))
        return (*words, *paths)

    async def _follow(self, number: int, job: Job, started: asyncio.subprocess.Process) -> None:
        """Wait for the end of a job, an hour at most, and write its row."""
        state = JobState.INTERRUPTED
        try:
            async with asyncio.timeout(LONGEST_S):
                status = await started.wait()
            _, error = _read_answer(self._folder / str(number) / ANSWER)
            if not error and status in _ANSWERED.get(job.command, (exit_status.DONE,)):
                state = JobState.DONE
            elif number in self._cancelled:
                state = JobState.CANCELLED
            else:
                state = JobState.FAILED
                if status < 0:
                    self._say(number, f"ended by signal {-status}; is there too little memory?")
        except TimeoutError:
            state = JobState.FAILED
            self._say(number, f"it took more than {LONGEST_S / 60.0:g} min and was ended")
        finally:
            await process.end(started)
            self._cancelled.discard(number)
            ended_at = {"state": state, "ended": rfc3339(now_ns())}
            with suppress(StoreFailedError):  # the watch of the store tells of it
                await self._put(number, job.model_copy(update=ended_at))
            del self._running[number], self._following[number]

    def _say(self, number: int, words: str) -> None:
        with suppress(OSError):
            append(self._folder / str(number) / LOG, f"{words}\n")

    async def _put(self, number: int | None, job: Job) -> int:
        """Write a row; returns its number."""
        row = (number, job.model_dump_json())

        def work(file: sqlite3.Connection) -> int:
            return file.execute("INSERT OR REPLACE INTO jobs VALUES (?, ?)", row).lastrowid or 0

        return await self._store.run(self._store.write, work)

    async def _forget_old(self) -> None:
        """Remove all but the newest jobs, with their folders."""
        old = "DELETE FROM jobs WHERE id <= (SELECT MAX(id) FROM jobs) - ?"
        await self._store.run(
            self._store.write, lambda file: file.execute(old, (MOST_KEPT,)).rowcount
        )
        newest = max(self._running)
        for folder in self._folder.iterdir():
            if folder.name.isdecimal() and int(folder.name) <= newest - MOST_KEPT:
                await self._threads.run(shutil.rmtree, folder, ignore_errors=True)

    def _answer(self, number: int, job: Job) -> JobAnswer:
        folder = self._folder / str(number)
        state = job.state
        if state is JobState.RUNNING and number not in self._running:
            state = JobState.INTERRUPTED
        lines = _last_lines(folder / LOG)
        stage, share, left_s = "", None, None
        if state is JobState.RUNNING and lines:
            stage, share, left_s = _progress(lines[-1])
        verdict, error = _read_answer(folder / ANSWER)
        files = sorted(
            path.name for path in folder.glob("[!.]*") if path.is_file() and path.stat().st_size
        )
        return JobAnswer(
            **job.model_dump(exclude={"state"}),
            id=number,
            state=state,
            stage=stage,
            share=share,
            left_s=left_s,
            lines=lines,
            files=files,
            verdict=verdict or error,
        )


def _last_lines(path: Path) -> list[str]:
    """The last lines of a log."""
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - _TAIL_BYTES, 0))
            return file.read(_TAIL_BYTES).decode(errors="replace").splitlines()[-_LINES:]
    except OSError:
        return []


def _progress(line: str) -> tuple[str, float | None, float | None]:
    """Stage, share and time left, s, by a line `edge-service COMMAND: STAGE, 40 %, 32 s`."""
    found = _PROGRESS.fullmatch(line)
    if found is None:
        return line, None, None
    if not found["percent"]:
        return found["stage"], None, None
    share = min(int(found["percent"]) / 100.0, 1.0)
    if not found["elapsed_s"] or share == 0.0:
        return found["stage"], share, None
    return found["stage"], share, float(found["elapsed_s"]) * (1.0 - share) / share


def _read_answer(path: Path) -> tuple[str | None, str | None]:
    """Verdict and error of a command's JSON answer, where it has them."""
    try:
        answer = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None, None
    verdict, error = answer.get("verdict"), answer.get("error")
    detail = str(error["detail"]) if error else None
    return (verdict if isinstance(verdict, str) else None), detail
