"""Routes of recordings and of jobs."""

import os
from collections.abc import AsyncIterator
from typing import Annotated, BinaryIO

from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, Response, StreamingResponse
from starlette.exceptions import HTTPException

from ..answers import AcceptedAnswer, Answer
from ..context import StateDep, check_axis
from ..jobs import JobAnswer, JobBody, Jobs, JobsAnswer
from ..problems import RefusedError, documented
from ..recordings import RecordingAnswer, RecordingName, Recordings

_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:"
)
"""A report shows its own styles and pictures, and can do nothing."""
_CHUNK_BYTES = 1 << 18

job_router = APIRouter(
    prefix="/api/v1",
    tags=["jobs"],
    responses=documented(404, 409, 422, 503),
)


class RecordingsAnswer(Answer):
    """All recordings, newest first."""

    recordings: list[RecordingAnswer]


async def _recordings_of(request: Request) -> Recordings:
    recordings: Recordings | None = request.app.state.recordings
    if recordings is None:
        raise HTTPException(503, "this service keeps no recordings")
    return recordings


async def _jobs_of(request: Request) -> Jobs:
    jobs: Jobs | None = request.app.state.jobs
    if jobs is None:
        raise HTTPException(503, "this service runs no jobs")
    return jobs


RecordingsDep = Annotated[Recordings, Depends(_recordings_of)]
JobsDep = Annotated[Jobs, Depends(_jobs_of)]


@job_router.get("/recordings", response_model=RecordingsAnswer)
async def recordings(kept: RecordingsDep) -> RecordingsAnswer:
    """Recordings that were uploaded or made here, newest first."""
    return RecordingsAnswer(recordings=kept.listed())


async def _opened(name: RecordingName, kept: RecordingsDep) -> AsyncIterator[BinaryIO]:
    """A recording, open until it is sent: it may be removed meanwhile."""
    try:
        file = kept.path(name).open("rb")
    except OSError as error:
        raise RefusedError(503, f"{name}: cannot be read ({error.strerror})") from None
    with file:
        yield file


@job_router.get("/recordings/{name}", response_class=StreamingResponse)
async def recording(
    name: RecordingName, file: Annotated[BinaryIO, Depends(_opened)]
) -> StreamingResponse:
    """A recording as a file."""
    headers = {
        "content-disposition": f'attachment; filename="{name}"',
        "content-length": str(os.fstat(file.fileno()).st_size),
    }
    chunks = iter(lambda: file.read(_CHUNK_BYTES), b"")
    return StreamingResponse(chunks, media_type="application/octet-stream", headers=headers)


@job_router.put(
    "/recordings/{name}",
    response_model=RecordingAnswer,
    status_code=201,
    openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}, "required": True}},
)
async def upload(name: RecordingName, request: Request, kept: RecordingsDep) -> RecordingAnswer:
    """Upload a trace file (CSV or Parquet) as the request's body."""
    return await kept.receive(name, request.stream())


@job_router.delete("/recordings/{name}", response_model=AcceptedAnswer)
async def remove(name: RecordingName, kept: RecordingsDep) -> AcceptedAnswer:
    """Forget a recording."""
    kept.remove(name)
    return AcceptedAnswer()


@job_router.get("/jobs", response_model=JobsAnswer)
async def all_jobs(jobs: JobsDep) -> JobsAnswer:
    """The last jobs, newest first."""
    return JobsAnswer(items=await jobs.all())


@job_router.post("/jobs", response_model=JobAnswer, status_code=202)
async def start(body: JobBody, state: StateDep, jobs: JobsDep, response: Response) -> JobAnswer:
    """Start a command in a process of its own, for an hour at most; two run at a time."""
    check_axis(state, body.axis)
    job = await jobs.start(body)
    response.headers["location"] = f"/api/v1/jobs/{job.id}"
    return job


@job_router.get("/jobs/{number}", response_model=JobAnswer)
async def one(number: int, jobs: JobsDep) -> JobAnswer:
    """One job: how far it is, what it said, what it made."""
    return await jobs.get(number)


@job_router.delete("/jobs/{number}", response_model=JobAnswer)
async def cancel(number: int, jobs: JobsDep) -> JobAnswer:
    """End a job that runs; a recording keeps what there is."""
    return await jobs.cancel(number)


@job_router.get("/jobs/{number}/files/{name}", response_class=FileResponse)
async def job_file(number: int, name: str, jobs: JobsDep) -> FileResponse:
    """A file that a job made, such as `report.html`."""
    path = await jobs.file(number, name)
    return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})
