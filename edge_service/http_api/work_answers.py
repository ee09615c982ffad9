"""What the routes about the work of one axis take and answer."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ..messages.alarm import AlarmKind
from .answers import Answer, EventAnswer, Timestamp


class NumberedEventAnswer(EventAnswer):
    """One event with the number under which the live stream knows it."""

    id: int


class LogAnswer(Answer):
    """Events and notes of an axis, oldest first."""

    axis: str
    events: list[NumberedEventAnswer]


class UseAnswer(Answer):
    """What the screw has done since the part is in use; null before anything was heard."""

    axis: str
    since: Timestamp
    moving_s: float
    observed_s: float
    distance_m: float
    reversals: int
    stroke_from_m: float
    stroke_to_m: float
    way_m: list[float] = Field(description="Way worked in each equal part of the stroke, m.")
    force_edges_n: list[float]
    force_way_m: list[float] = Field(description="Way worked under a force in each class, m.")


class FrictionAnswer(Answer):
    """Torque at steady speed, now and when the part was new, slowest class first."""

    axis: str
    speed_rad_s: list[float]
    torque_nm: list[float]
    first_torque_nm: list[float]
    count: list[int]


class ChannelAnswer(Answer):
    """One measured channel over the last minute."""

    channel: str
    state: str = Field(description="`ok`, `faulty` or `missing`.")
    good_share: float


class LiveAnswer(Answer):
    """The newest interval of one axis; null where a number was not measured."""

    axis: str
    time: Timestamp
    torque_nm: float | None
    speed_rad_s: float | None
    position_m: float | None
    transmission_um: float | None = Field(
        description="Table position less the way of the screw; its zero has no meaning."
    )
    temperature_c: float | None
    faults: list[str]


class TracesAnswer(Answer):
    """The last minutes of one axis, as columns, and the state of its channels."""

    axis: str
    time_s: list[float] = Field(description="UNIX times, s.")
    torque_nm: list[float | None]
    speed_rad_s: list[float | None]
    position_m: list[float | None]
    transmission_um: list[float | None]
    temperature_c: list[float | None]
    channels: list[ChannelAnswer]


class CommandBody(BaseModel):
    """What a person asks."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"action": "acknowledge", "alarm": "sudden_drop", "user": "Kim", "note": "seen"}
            ]
        },
    )

    action: Literal["acknowledge", "shelve", "unshelve", "note", "part_replaced"]
    alarm: AlarmKind | None = None
    user: str = Field(min_length=1, max_length=100)
    note: str = Field("", max_length=1000)
    duration_s: float = Field(8 * 3600.0, gt=0.0, le=30 * 86400.0, allow_inf_nan=False)


class AcceptedAnswer(Answer):
    """It was passed on; what came of it is an event."""

    accepted: bool = True
