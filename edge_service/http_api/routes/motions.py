"""Routes of a test: motions for the controller, and what the axis does recorded while it moves."""

from enum import StrEnum
from typing import Annotated, Protocol

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response
from pydantic import Field
from starlette.exceptions import HTTPException

from ..answers import Answer
from ..axis_answers import AcceptedAnswer
from ..context import AxisDep
from ..problems import documented

LONGEST_S = 3600.0


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


class RecordingBody(Answer):
    """Request to record an axis from now on."""

    motion: str = Field(
        "", pattern=r"^[a-z_]{0,30}$", description="Name of the motion, for the file's name."
    )
    seconds: float = Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False)


class LiveRecordingAnswer(Answer):
    """Recording that is being made."""

    axis: str
    name: str = Field(description="Name that it will have among the recordings.")
    seconds: float = Field(description="Length that was asked for, s.")
    recorded_s: float = Field(description="Length so far, s.")


class MotionDesk(Protocol):
    """Writes motions and records axes. Every call may raise RefusedError."""

    def motions(self, axis: str) -> list[MotionAnswer]:
        """All motions that end by themselves."""
        ...

    async def motion(self, axis: str, name: str, form: MotionForm) -> bytes:
        """A motion's file, within the limits of the axis."""
        ...

    def live(self) -> LiveRecordingAnswer | None:
        """The recording that is being made."""
        ...

    def record(self, axis: str, body: RecordingBody) -> LiveRecordingAnswer:
        """Begin to record; refused while another recording is made."""
        ...

    def stop(self, axis: str) -> None:
        """End a recording early, and keep what there is."""
        ...


motion_router = APIRouter(
    prefix="/api/v1/axes/{axis}",
    tags=["jobs"],
    responses=documented(404, 409, 422, 503),
)


async def desk_of(request: Request) -> MotionDesk:
    """Desk that writes motions and records axes."""
    desk: MotionDesk | None = request.app.state.motion_desk
    if desk is None:
        raise HTTPException(503, "this service makes no recordings")
    return desk


MotionDeskDep = Annotated[MotionDesk, Depends(desk_of)]


@motion_router.get("/motions", response_model=MotionsAnswer)
async def motions(axis: AxisDep, desk: MotionDeskDep) -> MotionsAnswer:
    """Motions that tell something about the axis, with their duration on it."""
    return MotionsAnswer(motions=desk.motions(axis))


@motion_router.get("/motions/{name}.{form}", response_class=Response)
async def motion(axis: AxisDep, name: str, form: MotionForm, desk: MotionDeskDep) -> Response:
    """A motion for the controller, within the limits of the axis: setpoints or an NC program."""
    content = await desk.motion(axis, name, form)
    headers = {"content-disposition": f'attachment; filename="{name}.{form.value}"'}
    return Response(content, media_type="text/plain", headers=headers)


@motion_router.get("/recording", response_model=LiveRecordingAnswer | None)
async def recording(axis: AxisDep, desk: MotionDeskDep) -> LiveRecordingAnswer | None:
    """The recording that is being made of the axis; null if there is none."""
    live = desk.live()
    return live if live is not None and live.axis == axis else None


@motion_router.post("/recording", response_model=LiveRecordingAnswer, status_code=202)
async def record(axis: AxisDep, body: RecordingBody, desk: MotionDeskDep) -> LiveRecordingAnswer:
    """Record what the axis does from now on; one recording is made at a time."""
    return desk.record(axis, body)


@motion_router.delete("/recording", response_model=AcceptedAnswer)
async def stop(axis: AxisDep, desk: MotionDeskDep) -> AcceptedAnswer:
    """End the recording early; what there is so far is kept."""
    desk.stop(axis)
    return AcceptedAnswer()
