"""Diagnosis of why model and axis disagree: asked for with a trace, answered by a job."""

import json
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from pydantic import ValidationError
from starlette.exceptions import HTTPException

from ..context import AxisDep, NowDep
from ..jobs import DiagnoseBody, JobAnswer, JobBody, JobKind, JobState, RefusedError
from ..problems import documented
from .jobs import DeskDep

MOST_UPLOADED_BYTES = 300_000_000
_MOST_NAMES_BYTES = 100_000
_SUFFIXES = {"text/csv": "csv", "application/vnd.apache.parquet": "parquet"}
_BYTES: dict[str, Any] = {"schema": {"type": "string", "format": "binary"}}
_EXAMPLE = {"recordings": ["disagreement_X_20261121T081530Z.parquet"]}
_BODY = {
    "required": True,
    "description": "Names of kept recordings, or one trace itself (up to 300 MB).",
    "content": {
        "application/json": {
            "schema": DiagnoseBody.model_json_schema(),
            "example": _EXAMPLE,
        },
        **dict.fromkeys(_SUFFIXES, _BYTES),
    },
}

diagnose_router = APIRouter(
    prefix="/api/v1/axes/{axis}", tags=["jobs"], responses=documented(404, 503)
)


@diagnose_router.post(
    "/diagnose",
    response_model=JobAnswer,
    status_code=202,
    responses=documented(409, 413, 415, 422, 507),
    openapi_extra={"requestBody": _BODY},
)
async def diagnose(
    axis: AxisDep, request: Request, response: Response, now_ns: NowDep, desk: DeskDep
) -> JobAnswer:
    """Diagnose kept recordings, or the trace in the body, in a process of its own.

    One job runs at a time. `DELETE /api/v1/jobs/{id}` cancels it, `GET /api/v1/jobs/{id}` tells
    its progress, and `GET /api/v1/axes/{axis}/diagnosis` the newest answer.
    """
    desk.check_free()
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind in _SUFFIXES:
        stamp = datetime.fromtimestamp(now_ns / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
        name = f"upload_{axis}_{stamp}.{_SUFFIXES[kind]}"
        names = [(await desk.receive(name, _bounded(request, MOST_UPLOADED_BYTES))).name]
    elif kind == "application/json":
        names = await _names(request)
    else:
        expected = ", ".join(("application/json", *_SUFFIXES))
        raise HTTPException(415, f"content type {kind!r}: expected {expected}")
    job = await desk.start(JobBody(kind=JobKind.DIAGNOSE, axis=axis, recordings=names))
    response.headers["location"] = f"/api/v1/jobs/{job.id}"
    return job


@diagnose_router.get("/diagnosis", response_class=FileResponse, responses=documented(409))
async def diagnosis(axis: AxisDep, desk: DeskDep) -> FileResponse:
    """The newest diagnosis of the axis as JSON, schema `diagnosis/1`."""
    job = desk.newest(JobKind.DIAGNOSE, axis)
    if job is None:
        raise HTTPException(404, f"axis {axis} was not diagnosed since the service started")
    if job.state is not JobState.DONE:
        said = f": {job.lines[-1]}" if job.lines else ""
        raise HTTPException(409, f"job {job.id} is {job.state.value}{said}")
    return FileResponse(desk.file(job.id, "diagnosis.json"), media_type="application/json")


async def _names(request: Request) -> list[str]:
    raw = b"".join([chunk async for chunk in _bounded(request, _MOST_NAMES_BYTES)])
    try:
        return DiagnoseBody.model_validate(json.loads(raw)).recordings
    except (ValidationError, ValueError, RecursionError):
        expected = json.dumps(_EXAMPLE)
        raise HTTPException(422, f"the body is no request: expected {expected}") from None


async def _bounded(request: Request, most_bytes: int) -> AsyncIterator[bytes]:
    size = 0
    async for chunk in request.stream():
        size += len(chunk)
        if size > most_bytes:
            raise RefusedError(413, f"the body is longer than {most_bytes / 1e6:g} MB")
        yield chunk
