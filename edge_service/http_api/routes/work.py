"""Routes of tests: motions for the controller, recordings, and jobs over them."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from fastapi import Path as InPath
from fastapi.responses import FileResponse, Response
from pydantic import Field

from ...messages.interval import Frozen
from ..context import AxisDep, Page, PagingDep, part
from ..jobs import Job, JobBody, Jobs
from ..problems import RefusedError
from ..recordings import Recording, RecordingName, Recordings

_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:"
)
"""A report shows its own styles and pictures, and can do nothing."""
_CACHED = {"cache-control": "private, max-age=3600"}

work_router = APIRouter(prefix="/api/v1", tags=["jobs"])


class MotionAnswer(Frozen):
    """One motion that tells something about an axis."""

    name: str = Field(examples=["friction"])
    purpose: str
    duration_s: float | None = Field(None, description="null if this axis does not allow it.")
    refused: str | None = Field(None, description="Why this axis does not allow it.")
    left_out: tuple[str, ...] = Field((), description="Parts that this axis does not allow.")


class Motions(Frozen):
    """All motions that end by themselves."""

    motions: list[MotionAnswer]


JobsDep = Annotated[Jobs, part("jobs")]
RecordingsDep = Annotated[Recordings, part("recordings")]
MotionsDep = Annotated[Callable[[str], list[MotionAnswer]], part("motions")]
Number = Annotated[int, InPath(alias="id")]


def _file(request: Request, path: Path, headers: dict[str, str]) -> Response:
    """A file with its tag; nothing but the tag for whoever has it already."""
    try:
        response = FileResponse(path, stat_result=path.stat(), headers=_CACHED | headers)
    except OSError as error:
        raise RefusedError(503, f"{path.name}: cannot be read ({error.strerror})") from None
    tag = response.headers["etag"]
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=_CACHED | {"etag": tag})
    return response


@work_router.get("/axes/{axis}/motions")
async def motions(axis: AxisDep, listed: MotionsDep) -> Motions:
    """Motions that tell something about the axis, with their duration on it."""
    return Motions(motions=listed(axis))


@work_router.get("/axes/{axis}/motions/{name}", response_class=Response)
async def motion(
    axis: AxisDep,
    name: str,
    jobs: JobsDep,
    listed: MotionsDep,
    form: Annotated[Literal["csv", "mpf"], Query(alias="format")],
) -> Response:
    """A motion for the controller, within the limits of the axis: setpoints or an NC program."""
    names = [each.name for each in listed(axis)]
    if name not in names:
        raise RefusedError(404, f"no motion {name!r}; there are {', '.join(names)}")
    content = await jobs.motion(axis, name, form)
    headers = {"content-disposition": f'attachment; filename="{name}.{form}"'}
    return Response(content, media_type="text/plain", headers=headers)


@work_router.get("/recordings")
async def recordings(kept: RecordingsDep, paging: PagingDep) -> Page[Recording]:
    """Recordings that were uploaded or made here, newest first."""
    found = await kept.page(paging.before, paging.limit + 1)
    return paging.page([each for _, each in found], [at_ns for at_ns, _ in found])


@work_router.get("/recordings/{name}", response_class=FileResponse)
async def recording(name: RecordingName, kept: RecordingsDep, request: Request) -> Response:
    """A recording as a file."""
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return _file(request, kept.path(name), headers)


@work_router.put(
    "/recordings/{name}",
    status_code=201,
    openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}, "required": True}},
)
async def upload(name: RecordingName, request: Request, kept: RecordingsDep) -> Recording:
    """Upload a recording, of any form that `adopt` reads, as the request's body."""
    return await kept.receive(name, request.stream())


@work_router.delete("/recordings/{name}", status_code=204)
async def remove(name: RecordingName, kept: RecordingsDep) -> None:
    """Forget a recording."""
    kept.remove(name)


@work_router.get("/jobs")
async def all_jobs(jobs: JobsDep, paging: PagingDep) -> Page[Job]:
    """Jobs, newest first."""
    found = await jobs.page(paging.before, paging.limit + 1)
    return paging.page(found, [each.id for each in found])


@work_router.post("/jobs", status_code=202)
async def start(body: JobBody, jobs: JobsDep, response: Response) -> Job:
    """Start a command in a process of its own, for an hour at most; two run at a time."""
    job = await jobs.start(body)
    response.headers["location"] = f"/api/v1/jobs/{job.id}"
    return job


@work_router.get("/jobs/{id}")
async def one(number: Number, jobs: JobsDep) -> Job:
    """One job: how far it is, what it said, what it made."""
    return await jobs.get(number)


@work_router.delete("/jobs/{id}")
async def cancel(number: Number, jobs: JobsDep) -> Job:
    """End a job that runs; a recording keeps what there is."""
    return await jobs.cancel(number)


@work_router.get("/jobs/{id}/files/{name}", response_class=FileResponse)
async def job_file(number: Number, name: str, jobs: JobsDep, request: Request) -> Response:
    """A file that a job made, such as `report.html`."""
    headers = {"content-security-policy": _REPORT_POLICY}
    return _file(request, await jobs.file(number, name), headers)
