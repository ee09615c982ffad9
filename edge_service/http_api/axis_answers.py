"""Requests and answers of the routes about the work of one axis."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..health.live_features import ChannelQuality
from ..messages.alarm import AlarmKind
from .answers import Answer, Timestamp

Measured = Annotated[
    float | None, AfterValidator(lambda value: None if value is None else float(f"{value:.7g}"))
]
"""A measured value to seven digits: more than any was measured with; null if it was not."""


class UseAnswer(Answer):
    """Use of the screw since the part was put into service; null before anything was heard."""

    axis: str
    since: Timestamp = Field(validation_alias="since_time_ns")
    moving_s: float
    observed_s: float
    distance_m: float
    reversals: int
    stroke_from_m: float
    stroke_to_m: float
    way_m: list[float] = Field(
        description="Distance travelled in each equal part of the stroke, m."
    )
    force_edges_n: list[float]
    force_way_m: list[float] = Field(
        description="Distance travelled under a force in each class, m."
    )


class ProfileAnswer(Answer):
    """A quantity along the stroke, (n,): as commissioned, and as the estimate implies now."""

    commissioned: list[float]
    value: list[float] | None = Field(description="null while there is no estimate.")
    low: list[float] | None
    high: list[float] | None


_STROKE_EXAMPLE: dict[str, Any] = {
    "axis": "X",
    "position_m": [0.0, 0.4, 0.8],
    "level": 0.95,
    "preload_percent": {
        "commissioned": [6.86, 6.84, 6.86],
        "value": [3.2, 3.19, 3.2],
        "low": [2.2, 2.19, 2.2],
        "high": [4.1, 4.09, 4.1],
    },
    "stiffness_n_per_m": {
        "commissioned": [4.65e7, 3.61e7, 2.95e7],
        "value": [4.12e7, 3.28e7, 2.72e7],
        "low": [3.71e7, 3.0e7, 2.52e7],
        "high": [4.63e7, 3.61e7, 2.96e7],
    },
}


class StrokeAnswer(Answer):
    """Preload and stiffness along the stroke; null if the machine file is not commissioned.

    The shape along the stroke is that of the commissioned axis, its level that of the estimate.
    """

    model_config = ConfigDict(json_schema_extra={"examples": [_STROKE_EXAMPLE]})

    axis: str
    position_m: list[float]
    level: float = Field(
        description="Probability with which each interval should contain the true value."
    )
    preload_percent: ProfileAnswer
    stiffness_n_per_m: ProfileAnswer | None = Field(
        description="Stiffness between motor and table; null without a linear encoder."
    )


class FrictionAnswer(Answer):
    """Torque at steady speed, now and when the part was new, slowest class first."""

    axis: str
    speed_rad_s: list[float]
    torque_nm: list[float]
    first_torque_nm: list[float]
    count: list[int]


class LiveAnswer(Answer):
    """The newest interval of one axis; null where a number was not measured."""

    axis: str
    time: Timestamp = Field(validation_alias="time_ns")
    torque_nm: Measured
    speed_rad_s: Measured
    position_m: Measured
    transmission_um: Measured = Field(
        description="Table position less the way of the screw; its zero has no meaning."
    )
    temperature_c: Measured
    faults: list[str]


class TracesAnswer(Answer):
    """The last minutes of one axis, as columns, and the state of its channels."""

    axis: str
    time_s: list[float] = Field(description="UNIX times, s.")
    torque_nm: list[Measured]
    speed_rad_s: list[Measured]
    position_m: list[Measured]
    transmission_um: list[Measured]
    temperature_c: list[Measured]
    channels: list[ChannelQuality]


class CommandBody(BaseModel):
    """Command given by a person."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "action": "acknowledge",
                    "alarm": "sudden_drop",
                    "occurrence": 1795000000123,
                    "user": "Kim",
                    "note": "seen",
                }
            ]
        },
    )

    action: Literal["acknowledge", "shelve", "unshelve", "note", "part_replaced"]
    alarm: AlarmKind | None = None
    occurrence: int | None = Field(
        None, ge=0, description="That of the alarm that is acknowledged; 409 once it is over."
    )
    user: str = Field(min_length=1, max_length=100)
    note: str = Field("", max_length=1000)
    duration_s: float = Field(8 * 3600.0, gt=0.0, le=30 * 86400.0, allow_inf_nan=False)


class AcceptedAnswer(Answer):
    """It was taken."""

    accepted: bool = True


class CommandAnswer(AcceptedAnswer):
    """It was done, and is kept."""

    outcome: str = Field("", examples=["alarm sudden drop acknowledged by Kim: seen"])
