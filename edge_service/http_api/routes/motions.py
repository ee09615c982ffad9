"""Routes of motions for the controller, by which an axis is tested."""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from pydantic import Field
from starlette.exceptions import HTTPException

from ..answers import Answer
from ..context import AxisDep
from ..problems import documented
from .jobs import JobsDep


class MotionForm(StrEnum):
    """Form of a motion's file."""

    CSV = "csv"  # setpoints
    MPF = "mpf"  # an NC program


class MotionAnswer(Answer):
    """One motion that tells something about an axis."""

    name: str = Field(examples=["friction"])
    purpose: str
    duration_s: float | None = Field(description="null if this axis does not allow it.")
    refused: str | None = Field(description="Why this axis does not allow it.")


class MotionsAnswer(Answer):
    """All motions that end by themselves."""

    motions: list[MotionAnswer]


ListMotions = Callable[[str], list[MotionAnswer]]
motion_router = APIRouter(
    prefix="/api/v1/axes/{axis}/motions",
    tags=["jobs"],
    responses=documented(404, 409, 422, 503),
)


@motion_router.get("", response_model=MotionsAnswer)
async def motions(axis: AxisDep, request: Request) -> MotionsAnswer:
    """Motions that tell something about the axis, with their duration on it."""
    listed: ListMotions | None = request.app.state.motions
    if listed is None:
        raise HTTPException(503, "this service writes no motions")
    return MotionsAnswer(motions=listed(axis))


@motion_router.get("/{name}", response_class=Response)
async def motion(
    axis: AxisDep, name: str, jobs: JobsDep, form: Annotated[MotionForm, Query(alias="format")]
) -> Response:
    """A motion for the controller, within the limits of the axis: setpoints or an NC program."""
    content = await jobs.motion(axis, name, form.value)
    headers = {"content-disposition": f'attachment; filename="{name}.{form.value}"'}
    return Response(content, media_type="text/plain", headers=headers)
