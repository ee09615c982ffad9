"""Routes of one axis: what is known of it, how it is configured, and commands about it."""

from collections.abc import Awaitable, Callable
from dataclasses import fields
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query
from pydantic import AfterValidator, ConfigDict, Field
from starlette.exceptions import HTTPException

from ...health.live_features import ChannelQuality, LivePoint
from ...messages.answer import PreloadAnswer
from ...messages.estimate import ImmEstimate
from ...messages.health import AlarmKind, AxisHealth, Command, Outcome
from ...messages.interval import Frozen
from ...messages.trend import FrictionCurve, Stroke, Use
from ..context import AxisDep, NowDep, StateDep, parameter_error, part
from ..guard import CallerDep

_ABOUT_AN_ALARM = ("acknowledge", "shelve", "unshelve")
_KEY = r'^("[!#-\[\]-~]{1,98}"|[!#-\[\]-~]{1,98})?$'
_COLUMNS = [each.name for each in fields(LivePoint) if each.name not in ("time_ns", "faults")]

IdempotencyKey = Annotated[
    str,
    Header(
        pattern=_KEY,
        description="Chosen by the client, new for each command (such as a UUID). A command "
        "that is sent again with the same key is answered as before and not carried out twice. "
        "The newest 100 keys of an axis are remembered.",
    ),
    AfterValidator(lambda key: key.strip('"')),
]
"""After draft-ietf-httpapi-idempotency-key-header; quotes may be left out."""
SendCommand = Callable[[str, Command], Awaitable[Outcome | None]]
"""Gives a command on an axis; its outcome, or None if nobody answers."""
axis_router = APIRouter(prefix="/api/v1/axes/{axis}", tags=["axes"])


class LiveAnswer(Frozen):
    """The last minutes of one axis as columns, null where nothing was measured."""

    axis: str
    time_s: list[float] = Field(description="UNIX times, s.")
    torque_nm: list[float | None]
    speed_rad_s: list[float | None]
    position_m: list[float | None]
    transmission_m: list[float | None] = Field(
        description="Table position less the travel of the screw; its zero has no meaning."
    )
    temperature_c: list[float | None]
    channels: list[ChannelQuality] = Field(description="State of each channel, last minute.")


class WearAnswer(Frozen):
    """Use of the screw, its state along the stroke, and its friction."""

    axis: str
    use: Use | None = Field(description="null before anything was heard.")
    stroke: Stroke | None = Field(description="null where the axis is not commissioned.")
    friction: FrictionCurve


class CommandBody(Frozen):
    """Command given by a person."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"action": "acknowledge", "alarm": "rate", "occurrence": 1795000000123}]
        },
    )

    action: Literal["acknowledge", "shelve", "unshelve", "note", "part_replaced"]
    alarm: AlarmKind | None = None
    occurrence: int | None = Field(
        None, ge=0, description="That of the alarm that is acknowledged; 409 once it is over."
    )
    user: str = Field("", max_length=100, description="Who asks, where no token says so.")
    note: str = Field("", max_length=1000)
    duration_s: float = Field(8 * 3600.0, gt=0.0, le=30 * 86400.0)


class CommandAnswer(Frozen):
    """It was done, and is kept."""

    outcome: str = Field(examples=["alarm “Sudden drop” acknowledged by Kim: seen"])


ReadStroke = Callable[[str, PreloadAnswer], Stroke | None]
"""Profiles along the stroke of an axis; None where it is not commissioned."""


@axis_router.get("/preload")
async def preload(axis: AxisDep, state: StateDep, now_ns: NowDep) -> PreloadAnswer:
    """Preload of one axis; numbers are null, never stale, unless the status is `estimated`."""
    return state.preload(axis, now_ns)


@axis_router.get("/imm")
async def imm(axis: AxisDep, state: StateDep, now_ns: NowDep) -> ImmEstimate:
    """Second opinion on one axis: the thesis' five levels of preload, by the drag alone."""
    return state.answer(axis, now_ns).opinion or ImmEstimate(axis=axis)


@axis_router.get("/health")
async def health(axis: AxisDep, state: StateDep, now_ns: NowDep) -> AxisHealth:
    """Condition of one axis, alarms, advice, trend, its components and data faults."""
    return state.health(axis, now_ns)


@axis_router.get("/live")
async def live(
    axis: AxisDep,
    state: StateDep,
    now_ns: NowDep,
    duration: Annotated[float, Query(gt=0.0, le=300.0, description="How far back, s.")] = 60.0,
) -> LiveAnswer:
    """Torque, speed, position, transmission difference and temperature of the last minutes."""
    points = tuple(state.live(axis).since(now_ns - round(duration * 1e9)))
    return LiveAnswer(
        axis=axis,
        time_s=[point.time_ns / 1e9 for point in points],
        channels=list(state.live(axis).channels()),
        **{name: [getattr(point, name) for point in points] for name in _COLUMNS},
    )


@axis_router.get("/wear")
async def wear(
    axis: AxisDep,
    state: StateDep,
    now_ns: NowDep,
    read: Annotated[ReadStroke, part("read_stroke")],
) -> WearAnswer:
    """Travel, hours, reversals and loads of the part in use; its stroke; its friction curve."""
    told = state.health(axis, now_ns)
    return WearAnswer(
        axis=axis,
        use=told.use,
        stroke=read(axis, state.preload(axis, now_ns)),
        friction=told.friction or FrictionCurve(),
    )


@axis_router.post("/commands", status_code=202)
async def command(
    axis: AxisDep,
    body: CommandBody,
    caller: CallerDep,
    send: Annotated[SendCommand, part("send_command")],
    idempotency_key: IdempotencyKey = "",
) -> CommandAnswer:
    """Acknowledge, shelve or unshelve an alarm, write a note, or say that a part was replaced.

    It is done, and kept, when this is answered; it is an event as well, in the live stream and in
    the log. 409: it would change nothing, or that occurrence is over. 503: nobody answered, so ask
    again with the same `Idempotency-Key`, or look at the log first. Whoever has sent a token is
    named by it, whatever `user` says.
    """
    if (body.alarm is None) == (body.action in _ABOUT_AN_ALARM):
        expected = "is needed for" if body.alarm is None else "has no meaning for"
        raise parameter_error("alarm", f"{expected} {body.action}")
    if (body.occurrence is None) == (body.action == "acknowledge"):
        expected = "is needed for" if body.occurrence is None else "has no meaning for"
        raise parameter_error("occurrence", f"{expected} {body.action}")
    user = caller.name or body.user
    if not user:
        raise parameter_error("user", "is needed where no token says who asks")
    asked = {"user": user, "origin": caller.origin, "key": idempotency_key}
    outcome = await send(axis, Command.model_validate(body.model_dump() | asked))
    if outcome is None:
        words = "the health node does not answer: it is not known whether the command was done"
        raise HTTPException(503, words)
    if outcome.reused:
        raise HTTPException(422, f"Idempotency-Key: {outcome.message}")
    if not outcome.accepted:
        raise HTTPException(409, outcome.message)
    if not outcome.kept:
        words = "carried out, but a restart will undo it unless it can soon be written to disk"
        raise HTTPException(507, f"{words}: {outcome.message}")
    return CommandAnswer(outcome=outcome.message)
