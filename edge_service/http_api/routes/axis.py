"""Routes of one axis' work, and commands of a person about it."""

from collections.abc import Awaitable, Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Request
from pydantic import AfterValidator
from starlette.exceptions import HTTPException

from ...messages.alarm import Command, Outcome
from ..access import CallerDep
from ..axis_answers import (
    CommandAnswer,
    CommandBody,
    FrictionAnswer,
    StrokeAnswer,
    TracesAnswer,
    UseAnswer,
)
from ..compose import (
    friction_answer,
    stroke_answer,
    traces_answer,
    use_answer,
)
from ..context import AxisDep, NowDep, StateDep, parameter_error
from ..problems import documented

_LOG_SPAN_S = 30 * 86400.0
_ABOUT_AN_ALARM = ("acknowledge", "shelve", "unshelve")
_KEY = r'^("[!#-\[\]-~]{1,98}"|[!#-\[\]-~]{1,98})?$'


def _unquoted(key: str) -> str:
    return key.strip('"')


IdempotencyKey = Annotated[
    str,
    Header(
        pattern=_KEY,
        description="Chosen by the client, new for each command (such as a UUID). A command "
        "that is sent again with the same key is answered as before and not carried out twice. "
        "The newest 100 keys of an axis are remembered.",
    ),
    AfterValidator(_unquoted),
]
"""After draft-ietf-httpapi-idempotency-key-header; quotes may be left out."""
SendCommand = Callable[[str, Command], Awaitable[Outcome | None]]
"""Gives a command on an axis; its outcome, or None if nobody answers."""

work_router = APIRouter(prefix="/api/v1/axes/{axis}", tags=["axes"], responses=documented(404))


async def send_command_of(request: Request) -> SendCommand | None:
    """Sender of commands; None if this service takes none."""
    send: SendCommand | None = request.app.state.send_command
    return send


@work_router.get("/traces", response_model=TracesAnswer)
async def traces(
    axis: AxisDep,
    state: StateDep,
    now_ns: NowDep,
    seconds: Annotated[float, Query(gt=0.0, le=300.0, description="How far back, s.")] = 60.0,
) -> TracesAnswer:
    """Torque, speed, position and transmission difference of the last minutes."""
    return traces_answer(state, axis, now_ns - round(seconds * 1e9))


@work_router.get("/use", response_model=UseAnswer | None)
async def use(axis: AxisDep, state: StateDep, now_ns: NowDep) -> UseAnswer | None:
    """Way, hours, reversals, load spectrum and map along the stroke of the part in use."""
    return use_answer(state, axis, now_ns)


@work_router.get("/stroke", response_model=StrokeAnswer | None)
async def stroke(axis: AxisDep, state: StateDep, now_ns: NowDep) -> StrokeAnswer | None:
    """Preload and stiffness along the stroke: as commissioned, and as the estimate implies now."""
    return stroke_answer(state, axis, now_ns)


@work_router.get("/friction", response_model=FrictionAnswer)
async def friction(axis: AxisDep, state: StateDep, now_ns: NowDep) -> FrictionAnswer:
    """The friction curve of ordinary work, now and when the part was new."""
    return friction_answer(state, axis, now_ns)


@work_router.post(
    "/commands",
    response_model=CommandAnswer,
    status_code=202,
    responses=documented(409, 422, 503, 507),
)
async def command(
    axis: AxisDep,
    body: CommandBody,
    caller: CallerDep,
    send: Annotated[SendCommand | None, Depends(send_command_of)],
    idempotency_key: IdempotencyKey = "",
) -> CommandAnswer:
    """Acknowledge, shelve or unshelve an alarm, write a note, or say that a part was replaced.

    It is done, and kept, when this is answered; it is an event as well, in the live stream and in
    the log. 409: it would change nothing, or that occurrence is over. 503: nobody answered, so ask
    again with the same `Idempotency-Key`, or look at the log first. Whoever has sent a token is
    named by it, whatever `user` says.
    """
    if send is None:
        raise HTTPException(503, "this service takes no commands")
    if (body.alarm is None) == (body.action in _ABOUT_AN_ALARM):
        expected = "is needed for" if body.alarm is None else "has no meaning for"
        raise parameter_error("alarm", f"{expected} {body.action}")
    if (body.occurrence is None) == (body.action == "acknowledge"):
        expected = "is needed for" if body.occurrence is None else "has no meaning for"
        raise parameter_error("occurrence", f"{expected} {body.action}")
    asked = {"user": caller.name or body.user, "origin": caller.origin}
    asked["key"] = idempotency_key
    outcome = await send(axis, Command.model_validate(body.model_dump() | asked))
    if outcome is None:
        raise HTTPException(
            503,
            "the health node does not answer: it is not known whether the command was carried out",
        )
    if outcome.reused:
        raise HTTPException(422, f"Idempotency-Key: {outcome.message}")
    if not outcome.accepted:
        raise HTTPException(409, outcome.message)
    if not outcome.kept:
        words = "carried out, but a restart will undo it unless it can soon be written to disk"
        raise HTTPException(507, f"{words}: {outcome.message}")
    return CommandAnswer(outcome=outcome.message)
