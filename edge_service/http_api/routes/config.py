"""Configuration of an axis: shown for any, made and changed for those of the page."""

import tomllib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.responses import PlainTextResponse, Response
from pydantic import BeforeValidator, ConfigDict, Field

from ...messages.interval import Frozen
from ..context import AxisDep, parameter_error, part

TomlTable = Annotated[
    dict[str, Any],
    BeforeValidator(lambda sent: tomllib.loads(sent) if isinstance(sent, str) else sent),
]
"""An object, or the same as TOML text."""


class AxisConfiguration(Frozen):
    """One axis as it is configured; a password is `***`, and stays if it is sent so."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"driver": "simulated", "settings": {"seed": 1}}]}
    )

    axis: str = Field("", description="That of the path.")
    driver: str
    settings: TomlTable = Field({}, description="Of the driver; as a text it is read as TOML.")
    limits: dict[Literal["warning_percent", "fault_percent"], float] = Field(
        {}, description="Percent of the fresh screw's preload; those of [alarms] without."
    )
    machine: TomlTable | None = Field(
        None,
        description="The machine file, also as TOML text; without it that of before stays.",
    )


@dataclass(frozen=True, slots=True)
class AxisConfigurations:
    """Reading and changing configurations; all but `read` may raise RefusedError."""

    # configuration of an axis, and its table as TOML
    read: Callable[[str], tuple[AxisConfiguration, str]]
    # keeps an axis and begins it; returns whether it is new
    put: Callable[[str, AxisConfiguration], Awaitable[bool]]
    remove: Callable[[str], Awaitable[None]]  # removes an axis that was made so


ConfigurationsDep = Annotated[AxisConfigurations, part("configurations")]
config_router = APIRouter(prefix="/api/v1/axes/{axis}/config", tags=["axes"])


@config_router.get(
    "",
    response_model=AxisConfiguration,
    responses={200: {"content": {"application/toml": {}}}},
)
async def config(
    axis: AxisDep,
    configurations: ConfigurationsDep,
    form: Annotated[Literal["json", "toml"], Query(alias="format")] = "json",
) -> AxisConfiguration | Response:
    """The axis as it is configured: driver, its settings, limits, machine file."""
    answer, toml = configurations.read(axis)
    return answer if form == "json" else PlainTextResponse(toml, media_type="application/toml")


@config_router.put(
    "",
    response_model=AxisConfiguration,
    responses={201: {"description": "The axis is new."}},
)
async def put_config(
    axis: str, body: AxisConfiguration, configurations: ConfigurationsDep, response: Response
) -> AxisConfiguration:
    """Check an axis as `check-config` does, keep it, and start it alone.

    409: the axis stands in the configuration, which names the line to change.
    """
    if body.axis not in ("", axis):
        raise parameter_error("axis", f"expected {axis!r}, as in the path")
    if await configurations.put(axis, body):
        response.status_code = 201
    return configurations.read(axis)[0]


@config_router.delete("", status_code=204)
async def remove_config(axis: AxisDep, configurations: ConfigurationsDep) -> None:
    """Stop and remove an axis that was made by this route; its history stays."""
    await configurations.remove(axis)
