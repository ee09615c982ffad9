"""Jobs: commands that run beside the service, each one process, one row and one folder."""

import asyncio
import json
import re
import shutil
import sqlite3
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, ValidationError, model_validator

from .. import exit_status, process
from ..atomic import append, made_folder, new_file
from ..clock import now_ns
from ..health.store.store import Store, StoreFailedError
from ..messages.interval import Frozen, TimeNs
from ..messages.keys import check_part
from ..threads import Threads
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
_GIVEN = r"^--(assume-fresh|(set|column|torque-constant|period|axis-number)=[^\x00-\x1f]{1,300})$"
JobCommand = Literal["record", "adopt", "doctor", "commission", "fingerprint", "diagnose", "update"]
JobState = Literal["running", "done", "failed", "cancelled", "interrupted"]
"""`interrupted`: the service ended while it ran."""
_OUT = {"adopt": "machine.toml", "commission": "commissioned.toml"}
_OUT |= {"fingerprint": "", "diagnose": "", "update": "updated.toml"}
"""File that a command writes into the job's folder; empty: it fills the folder itself."""
_ANSWERED = dict.fromkeys(("doctor", "update"), (exit_status.DONE, exit_status.INTERNAL_FAILURE))
_ANSWERED["diagnose"] = exit_status.DONE, exit_status.BAD_DATA
"""Exit statuses with an answer, where there are more than one."""


class JobOptions(Frozen):
    """Options of a job's command."""

    duration_s: float | None = Field(None, gt=0.0, le=LONGEST_S, description="Of `record`, s.")
    baseline: int | None = Field(None, description="Of `fingerprint`: job with an older one.")
    machine: int | None = Field(None, description="Job with the machine file; else the axis' own.")
    given: list[Annotated[str, Field(pattern=_GIVEN)]] = Field(
        [], max_length=50, description="Of `adopt` and `commission`: options, as on a command line."
    )


class JobBody(Frozen):
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
        check_part(self.axis)
        if self.command == "record":
            if self.options.duration_s is None or len(self.recordings) > 1:
                raise ValueError("record: expected options.duration_s, and at most one recording")
        elif not self.recordings:
            raise ValueError(f"recordings: {self.command} needs one at least")
        return self


class Job(JobBody):
    """One job."""

    model_config = ConfigDict(json_schema_extra={"examples": []})

    id: int = 0
    state: JobState = "running"
    started: TimeNs
    ended: TimeNs | None = None
    stage: str = Field("", description="What it does now.")
    share: float | None = Field(None, description="Part that is done, 0 to 1; null: unknown.")
    left_s: float | None = Field(None, description="Time that it may still take, s.")
    lines: list[str] = Field([], description="The last lines of its log.")
    files: list[str] = Field([], description="What it has made so far.")
    verdict: str | None = Field(None, description="What its answer says, or its error.")


class Jobs:
    """Jobs of one service. Every call may raise RefusedError, StoreFailedError."""

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

    async def page(self, before: int, most: int) -> list[Job]:
        """Jobs with lower numbers than `before`, newest first."""
        wanted = "SELECT id, body FROM jobs WHERE id < ? ORDER BY id DESC LIMIT ?"

        def rows(file: sqlite3.Connection) -> list[tuple[int, str]]:
            return file.execute(wanted, (before, most)).fetchall()

        jobs = []
        for number, body in await self._store.run(self._store.read, rows):
            with suppress(ValidationError):  # damage in the file: what is left of it is not shown
                jobs.append(self._shown(number, Job.model_validate_json(body)))
        return jobs

    async def get(self, number: int) -> Job:
        """One job."""
        found = await self.page(number + 1, 1) if 0 < number < 2**62 else []
        if not found or found[0].id != number:
            raise RefusedError(404, f"there is no job {number}")
        return found[0]

    async def start(self, body: JobBody) -> Job:
        """Start a job; refused while as many run as may."""
        async with self._one:
            if len(self._running) >= MOST_AT_ONCE:
                raise RefusedError(409, f"{MOST_AT_ONCE} jobs are running: wait, or cancel one")
            words = await self._words(body)
            job = Job(**body.model_dump(), started=now_ns())
            number = await self._put(None, job)
            folder = self._folder / str(number)
            if body.command in _OUT:
                words += ("--out", str(folder / _OUT[body.command]))
            try:
                await self._threads.run(shutil.rmtree, folder, ignore_errors=True)
                made_folder(folder)
                with new_file(folder / LOG) as log, new_file(folder / ANSWER) as answer:
                    started = await process.started(*words, stdout=answer, stderr=log)
            except OSError as error:
                await self._put(number, job.model_copy(update={"state": "failed"}))
                refused = f"job {number} cannot be started ({error.strerror})"
                raise RefusedError(503, refused) from None
            self._running[number] = started
            self._following[number] = asyncio.create_task(self._follow(number, job, started))
            old = "DELETE FROM jobs WHERE id <= (SELECT MAX(id) FROM jobs) - ? RETURNING id"

            def forget(file: sqlite3.Connection) -> list[tuple[int]]:
                return file.execute(old, (MOST_KEPT,)).fetchall()

            for (gone,) in await self._store.run(self._store.write, forget):
                left = self._folder / str(gone)
                await self._threads.run(shutil.rmtree, left, ignore_errors=True)
            return self._shown(number, job)

    async def cancel(self, number: int) -> Job:
        """End a job that runs; a recording keeps what there is."""
        if number not in self._running:
            job = await self.get(number)
            raise RefusedError(409, f"job {number} is {job.state} and cannot be cancelled")
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
            words = ("motion", name, "--clip", f"--machine={self._machines[axis]}", f"--out={out}")
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
        await asyncio.gather(*following, return_exceptions=True)

    async def _words(self, body: JobBody) -> tuple[str, ...]:
        """Arguments of a command, without --out of what it writes into its folder."""
        words: tuple[str, ...] = (body.command, "--json")
        machine = self._machines.get(body.axis)
        if body.options.machine is not None:
            made = await self.get(body.options.machine)
            machine = await self.file(made.id, _OUT.get(made.command, ""))
        if machine is None and body.command != "adopt":
            raise RefusedError(404, f"there is no axis {body.axis!r}")
        if body.command == "record":
            now = datetime.fromtimestamp(now_ns() / 1e9, UTC)
            names = body.recordings or [f"record_{body.axis}_{now:%Y%m%dT%H%M%SZ}.parquet"]
            out = self._recordings.place(names[0])
            words += ("--axis", body.axis, "--duration", f"{body.options.duration_s}")
            return (*words, "--out", str(out), *self._service)
        named = ("--axis", body.axis) if body.command == "adopt" else ("--machine", str(machine))
        words += named + tuple(body.options.given)
        if body.options.baseline is not None and body.command == "fingerprint":
            baseline = await self.file(body.options.baseline, "fingerprint.json")
            words += ("--baseline", str(baseline))
        return (*words, *(str(self._recordings.path(name)) for name in body.recordings))

    async def _follow(self, number: int, job: Job, started: asyncio.subprocess.Process) -> None:
        """Wait for the end of a job, an hour at most, and write its row."""
        state: JobState = "interrupted"
        folder = self._folder / str(number)
        try:
            async with asyncio.timeout(LONGEST_S):
                status = await started.wait()
            _, error = _read_answer(folder / ANSWER)
            if not error and status in _ANSWERED.get(job.command, (exit_status.DONE,)):
                state = "done"
            elif number in self._cancelled:
                state = "cancelled"
            else:
                state = "failed"
                if status < 0:
                    _say(folder, f"ended by signal {-status}; is there too little memory?")
        except TimeoutError:
            state = "failed"
            _say(folder, f"it took more than {LONGEST_S / 60.0:g} min and was ended")
        finally:
            await process.end(started)
            self._cancelled.discard(number)
            with suppress(StoreFailedError):  # the watch of the store tells of it
                ended = {"state": state, "ended": now_ns()}
                await self._put(number, job.model_copy(update=ended))
            del self._running[number], self._following[number]

    async def _put(self, number: int | None, job: Job) -> int:
        row = (number, job.model_dump_json())

        def work(file: sqlite3.Connection) -> int:
            return file.execute("INSERT OR REPLACE INTO jobs VALUES (?, ?)", row).lastrowid or 0

        return await self._store.run(self._store.write, work)

    def _shown(self, number: int, job: Job) -> Job:
        folder = self._folder / str(number)
        state, lines = job.state, _last_lines(folder / LOG)
        if state == "running" and number not in self._running:
            state = "interrupted"
        progress = _progress(lines[-1]) if state == "running" and lines else {}
        verdict, error = _read_answer(folder / ANSWER)
        made = [path for path in folder.glob("[!.]*") if path.is_file() and path.stat().st_size]
        files = sorted(path.name for path in made)
        known = {"id": number, "state": state, "lines": lines, "files": files}
        return job.model_copy(update=known | progress | {"verdict": verdict or error})


def _say(folder: Path, words: str) -> None:
    with suppress(OSError):
        append(folder / LOG, f"{words}\n")


def _last_lines(path: Path) -> list[str]:
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - _TAIL_BYTES, 0))
            return file.read(_TAIL_BYTES).decode(errors="replace").splitlines()[-_LINES:]
    except OSError:
        return []


def _progress(line: str) -> dict[str, str | float]:
    """Stage, share and time left, s, by a line `edge-service COMMAND: STAGE, 40 %, 32 s`."""
    found = _PROGRESS.fullmatch(line)
    if found is None or not found["percent"]:
        return {"stage": line if found is None else found["stage"]}
    share = min(int(found["percent"]) / 100.0, 1.0)
    progress: dict[str, str | float] = {"stage": found["stage"], "share": share}
    if found["elapsed_s"] and share:
        progress["left_s"] = float(found["elapsed_s"]) * (1.0 - share) / share
    return progress


def _read_answer(path: Path) -> tuple[str | None, str | None]:
    """Verdict and error of a command's JSON answer, where it has them."""
    try:
        answer = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None, None
    verdict, error = answer.get("verdict"), answer.get("error")
    detail = str(error["detail"]) if error else None
    return (verdict if isinstance(verdict, str) else None), detail
