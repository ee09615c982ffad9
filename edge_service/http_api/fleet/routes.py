"""Routes of a fleet node: the table of the plant, the past of an axis, machines that are gone."""

import logging
from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from ...health.fleet.plant_rows import FleetNodeState, PlantTable, moment
from ...health.fleet.rows import WORST_FIRST, FleetRow
from ...messages.fleet import HistoryPoint, HistoryQuestion, Hole
from ...messages.health import AxisCondition
from ..answers import AliveAnswer, ReadyAnswer
from ..context import Moment, moment_query
from ..problems import documented, problem_response
from ..security.gate import identity_of
from .desk import FleetDesk

log = logging.getLogger(__name__)
MOST_ROWS = 500
_PAGE = 200
fleet_router = APIRouter(prefix="/api/v1/fleet", tags=["fleet"])
state_router = APIRouter(tags=["service"])


class FleetAnswer(BaseModel):
    """Axes of the plant that were asked for, the worst first, and what holds for all of it."""

    node: str = Field(description="Fleet node that answers.")
    condition: AxisCondition | None = Field(description="The worst of all axes; null without any.")
    counts: dict[str, int] = Field(description="Condition -> number of axes in the whole plant.")
    faster: int = Field(description="Axes that wear faster than their peers, beyond doubt.")
    axes: int = Field(description="Axes in the whole plant.")
    machines: int
    sites: list[str]
    missing: list[str] = Field(description="What is not shown as it is now; empty if nothing is.")
    nodes: list[FleetNodeState]
    matching: int = Field(description="Axes that the filter lets through.")
    offset: int
    rows: list[FleetRow]


class PastPoint(BaseModel):
    """Axis at one report of its machine's log."""

    time: str
    condition: AxisCondition
    preload_percent: float | None
    low: float | None
    high: float | None
    share_percent: float | None
    log: str
    number: int


class PastAnswer(BaseModel):
    """Kept past of one axis, the oldest first."""

    site: str
    machine: str
    axis: str
    points: list[PastPoint]
    holes: list[Hole] = Field(description="Reports of the machine's log that nobody has any more.")
    missing: list[str]


async def desk_of(request: Request) -> FleetDesk:
    """The fleet node that the application was made with."""
    desk: FleetDesk = request.app.state.fleet
    return desk


DeskDep = Annotated[FleetDesk, Depends(desk_of)]


@state_router.get("/livez", response_model=AliveAnswer)
async def alive() -> AliveAnswer:
    """Tell whether the process answers."""
    return AliveAnswer()


@state_router.get("/readyz", response_model=ReadyAnswer, responses=documented(503))
async def ready(request: Request, desk: DeskDep) -> ReadyAnswer | Response:
    """Tell whether the fleet node reads its part of the plant; 503 with reasons if not."""
    reasons = desk.unready()
    if not reasons:
        return ReadyAnswer()
    detail = "the fleet node does not read its part of the plant"
    return problem_response(request.url.path, 503, detail, reasons=reasons)


@fleet_router.get("", response_model=FleetAnswer)
async def fleet(
    desk: DeskDep,
    search: Annotated[str, Query(max_length=200, description="Part of the axis' name.")] = "",
    site: Annotated[str, Query(max_length=100)] = "",
    machine: Annotated[str, Query(max_length=100)] = "",
    condition: Annotated[AxisCondition | None, Query()] = None,
    faster: Annotated[bool, Query(description="Only those that outpace their peers.")] = False,
    offset: Annotated[int, Query(ge=0, le=10_000_000)] = 0,
    limit: Annotated[int, Query(ge=1, le=MOST_ROWS)] = _PAGE,
) -> FleetAnswer:
    """Every axis of the plant, the worst first."""
    table = await desk.table()
    found = [
        row
        for row in table.rows
        if (not site or row.site == site)
        and (not machine or row.machine == machine)
        and (condition is None or row.condition is condition)
        and (not faster or (row.peers is not None and row.peers.faster))
        and search.lower() in f"{row.site}/{row.machine}/{row.axis}".lower()
    ]
    return _answer(desk.name, table, found, offset, limit)


def _answer(
    node: str, table: PlantTable, found: Sequence[FleetRow], offset: int, limit: int
) -> FleetAnswer:
    conditions = [row.condition for row in table.rows]
    counts = {each: conditions.count(each) for each in WORST_FIRST}
    return FleetAnswer(
        node=node,
        condition=next((each for each in WORST_FIRST if counts[each]), None),
        counts={str(each): count for each, count in counts.items()},
        faster=sum(row.peers is not None and row.peers.faster for row in table.rows),
        axes=len(table.rows),
        machines=table.machines,
        sites=sorted({row.site for row in table.rows}),
        missing=list(table.missing),
        nodes=list(table.nodes),
        matching=len(found),
        offset=offset,
        rows=list(found[offset : offset + limit]),
    )


@fleet_router.get(
    "/{site}/{machine}/{axis}/history", response_model=PastAnswer, responses=documented(404, 422)
)
async def history(
    desk: DeskDep,
    site: str,
    machine: str,
    axis: str,
    since: Annotated[Moment, moment_query("from", "all that is kept")] = 0.0,
) -> PastAnswer:
    """Past of one axis, as the logs of its machine tell it."""
    asked = HistoryQuestion(site=site, machine=machine, axis=axis, since_ns=int(since * 1e9))
    past = await desk.past(asked)
    if not past.points and not await _is_known(desk, site, machine, axis):
        raise HTTPException(404, f"the plant has no axis {site}/{machine}/{axis}")
    return PastAnswer(
        site=site,
        machine=machine,
        axis=axis,
        points=[_point(point) for point in past.points],
        holes=list(past.holes),
        missing=list(past.missing),
    )


async def _is_known(desk: FleetDesk, site: str, machine: str, axis: str) -> bool:
    wanted = (site, machine, axis)
    return any((row.site, row.machine, row.axis) == wanted for row in (await desk.table()).rows)


def _point(point: HistoryPoint) -> PastPoint:
    percent, fresh = point.preload_percent, point.fresh_percent
    return PastPoint(
        time=moment(point.time_ns),
        condition=point.condition,
        preload_percent=percent,
        low=point.low,
        high=point.high,
        share_percent=None if percent is None or not fresh else 100.0 * percent / fresh,
        log=point.log,
        number=point.number,
    )


@fleet_router.delete("/{site}/{machine}", status_code=204, responses=documented(404))
async def remove(request: Request, desk: DeskDep, site: str, machine: str) -> Response:
    """Take a machine that is gone out of the list; it comes back when it is heard again."""
    if not await desk.remove(site, machine):
        raise HTTPException(404, f"the plant has no machine {site}/{machine}")
    who = identity_of(request).name or "somebody"
    log.info("%s has taken %s/%s out of the list", who, site, machine)
    return Response(status_code=204)
