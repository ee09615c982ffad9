"""Diagnosis of why model and axis disagree: asked for with a trace, answered by a job."""

import json
from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from pydantic import ValidationError
from starlette.exceptions import HTTPException

from ..context import AxisDep, NowDep
from ..guard import TRACE_TYPES, content_type
from ..jobs import DiagnoseBody, JobAnswer, JobBody, JobKind, JobState
from ..problems import documented
from .jobs import DeskDep

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
        **dict.fromkeys(TRACE_TYPES, _BYTES),
    },
}

diagnose_router = APIRouter(
    prefix="/api/v1/axes/{axis}",
    tags=["jobs"],
    responses=documented(404, 503),
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
    kind = content_type(request.headers)
    if kind in TRACE_TYPES:
        stamp = datetime.fromtimestamp(now_ns / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
        name = f"upload_{axis}_{stamp}.{TRACE_TYPES[kind]}"
        names = [(await desk.receive(name, request.stream())).name]
    elif kind == "application/json":
        names = await _names(request)
    else:
        expected = ", ".join(("application/json", *TRACE_TYPES))
        raise HTTPException(415, f"content type {kind!r}: expected {expected}")
    job = await desk.start(JobBody(kind=JobKind.DIAGNOSE, axis=axis, recordings=names))
    response.headers["location"] = f"/api/v1/jobs/{job.id}"
    return job


@diagnose_router.get("/diagnosis", response_class=FileResponse, responses=documented(409))
async def diagnosis(axis: AxisDep, desk: DeskDep) -> FileResponse:
    """The newest diagnosis of the axis as JSON, schema `diagnosis/1`."""
    job = desk.newest(JobKind.DIAGNOSE, axis)
    if job is None:
        raise HTTPException(404, f"axis {axis} has not been diagnosed since the service started")
    if job.state is not JobState.DONE:
        said = f": {job.lines[-1]}" if job.lines else ""
        raise HTTPException(409, f"job {job.id} is {job.state.value}{said}")
    return FileResponse(desk.file(job.id, "diagnosis.json"), media_type="application/json")


async def _names(request: Request) -> list[str]:
    try:
        return DiagnoseBody.model_validate(json.loads(await request.body())).recordings
    except (ValidationError, ValueError, RecursionError):
        expected = json.dumps(_EXAMPLE)
        raise HTTPException(422, f"the request body is not valid: expected {expected}") from None
