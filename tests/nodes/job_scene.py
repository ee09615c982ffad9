"""The routes over a job desk whose jobs are small programs."""

import asyncio
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import httpx

from edge_service.config import DEFAULT_MACHINE
from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app
from edge_service.http_api.jobs import JobKind
from edge_service.nodes.jobs.job_desk import ProcessJobDesk

from .conftest import heart, until

CHILD = """
import pathlib, sys, time
out = pathlib.Path(sys.argv[1]); out.mkdir(parents=True)
print("working", flush=True)
if sys.argv[2] == "long": time.sleep(60)
if sys.argv[2] == "bad": sys.exit("trace.csv: no time_s")
(out / "report.html").write_text("<p>fine</p>")
(out / "fingerprint.json").write_text("{}")
(out / "diagnosis.json").write_text('{"schema": "diagnosis/1"}')
"""


def _child(word: str):
    def command(
        machine: Path, recordings: Sequence[Path], out: Path, baseline: Path | None
    ) -> list[str]:
        assert all(path.exists() for path in recordings)
        return [sys.executable, "-c", CHILD, str(out), word]

    return command


class JobScene:
    """The routes over a desk whose jobs are small programs."""

    def __init__(self, folder: Path) -> None:
        self.desk = ProcessJobDesk(folder, {"X": DEFAULT_MACHINE})
        app = create_app(ServiceState({"X": None}, 0), lambda: 0, desk=self.desk)
        transport = httpx.ASGITransport(app=app, raise_app_exceptions=False)
        self.client = httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1/api/v1/")

        self._following = asyncio.create_task(self.desk.run(heart()))

    async def close(self) -> None:
        """The service ends."""
        await self.client.aclose()
        self._following.cancel()
        await asyncio.wait([self._following])
        await self.desk.close()

    def let(self, word: str) -> None:
        """Work of fingerprint jobs from now on."""
        self.desk._commands = {kind: _child(word) for kind in JobKind}

    async def start(self, **more: object) -> httpx.Response:
        """Start a fingerprint of trace.csv."""
        body = {"kind": "fingerprint", "axis": "X", "recordings": ["trace.csv"]} | more
        return await self.client.post("jobs", json=body)

    async def ended(self) -> dict[str, object]:
        """The newest job, once it is over."""

        async def over() -> object:
            job = (await self.client.get("jobs")).json()["jobs"][0]
            return job if job["state"] != "running" else None

        return await until(over)


async def followed(desk: ProcessJobDesk) -> None:
    """Follow the jobs that were started until all have ended."""
    following = asyncio.create_task(desk.run(heart()))

    async def over() -> bool:
        return not any(job.running for job in desk._jobs.values())

    await until(over)
    following.cancel()
    await asyncio.wait([following])


@asynccontextmanager
async def scene_in(folder: Path) -> AsyncIterator[JobScene]:
    """A scene with one recording, trace.csv, whose jobs are short."""
    jobs = JobScene(folder)
    jobs.let("short")
    await jobs.client.put("recordings/trace.csv", content=b"time_s\n0\n")
    yield jobs
    await jobs.close()
