"""Routes of recordings and of the jobs that are made of them."""

import os
from collections.abc import AsyncIterator
from typing import Annotated, BinaryIO

from fastapi import APIRouter, Depends, Request
from fastapi.responses import FileResponse, Response, StreamingResponse
from starlette.exceptions import HTTPException

from ..axis_answers import AcceptedAnswer
from ..context import StateDep, check_axis
from ..jobs import (
    JobAnswer,
    JobBody,
    JobDesk,
    JobsAnswer,
    RecordingAnswer,
    RecordingName,
    RecordingsAnswer,
    RefusedError,
)
from ..problems import documented, problem_response

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


async def desk_of(request: Request) -> JobDesk:
    """Desk that keeps recordings and runs jobs."""
    desk: JobDesk | None = request.app.state.desk
    if desk is None:
        raise HTTPException(503, "this service runs no jobs")
    return desk


async def on_refused(request: Request, error: Exception) -> Response:
    """A refusal as a problem document."""
    assert isinstance(error, RefusedError)
    return problem_response(request.url.path, error.status, str(error))


DeskDep = Annotated[JobDesk, Depends(desk_of)]


@job_router.get("/recordings", response_model=RecordingsAnswer)
async def recordings(desk: DeskDep) -> RecordingsAnswer:
    """Recordings that were uploaded, newest first."""
    return RecordingsAnswer(recordings=desk.recordings())


async def opened(name: RecordingName, desk: DeskDep) -> AsyncIterator[BinaryIO]:
    """A recording, open until it is sent: it may be removed meanwhile."""
    try:
        file = desk.recording(name).open("rb")
    except OSError as error:
        raise RefusedError(503, f"{name}: cannot be read ({error.strerror})") from None
    with file:
        yield file


@job_router.get("/recordings/{name}", response_class=StreamingResponse)
async def recording(
    name: RecordingName, file: Annotated[BinaryIO, Depends(opened)]
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
async def upload(name: RecordingName, request: Request, desk: DeskDep) -> RecordingAnswer:
    """Upload a trace file (CSV or Parquet) as the request's body."""
    return await desk.receive(name, request.stream())


@job_router.delete("/recordings/{name}", response_model=AcceptedAnswer)
async def remove(name: RecordingName, desk: DeskDep) -> AcceptedAnswer:
    """Forget a recording."""
    desk.remove(name)
    return AcceptedAnswer()


@job_router.get("/jobs", response_model=JobsAnswer)
async def jobs(desk: DeskDep) -> JobsAnswer:
    """Jobs since the service started, newest first."""
    return JobsAnswer(jobs=desk.jobs())


@job_router.post("/jobs", response_model=JobAnswer, status_code=202)
async def start(body: JobBody, state: StateDep, desk: DeskDep) -> JobAnswer:
    """Start a fingerprint, a diagnosis or a comparison of the same moves; one runs at a time.

    It runs in a process of its own.
    """
    check_axis(state, body.axis)
    return await desk.start(body)


@job_router.get("/jobs/{number}", response_model=JobAnswer)
async def job(number: int, desk: DeskDep) -> JobAnswer:
    """One job: how far it is, what it said, what it made."""
    found = next((each for each in desk.jobs() if each.id == number), None)
    if found is None:
        raise HTTPException(404, f"there is no job {number}")
    return found


@job_router.delete("/jobs/{number}", response_model=JobAnswer)
async def cancel(number: int, desk: DeskDep) -> JobAnswer:
    """Cancel a job that runs."""
    return await desk.cancel(number)


@job_router.get("/jobs/{number}/files/{name}", response_class=FileResponse)
async def job_file(number: int, name: str, desk: DeskDep) -> FileResponse:
    """A file that a job made, such as `report.html`."""
    path = desk.file(number, name)
    return FileResponse(path, headers={"content-security-policy": _REPORT_POLICY})
