"""Log of events: what happened, what people wrote, and who did what from where."""

from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Query
from pydantic import Field

from ...messages.event import Event
from ..answers import Answer
from ..context import AxisFilterDep, Moment, StateDep, from_history, moment_query
from ..problems import documented

log_router = APIRouter(prefix="/api/v1", tags=["service"])
_PATH = "/api/v1/log"
_LAST_NS = 2**63 - 1


class NumberedEvent(Event):
    """One event with the number under which the live stream knows it."""

    id: int


class LogAnswer(Answer):
    """Part of the log, newest first."""

    items: list[NumberedEvent]
    next: str | None = Field(
        description="Address of the events before these; null at the end.",
        examples=[f"{_PATH}?cursor=1795000000000000&limit=100"],
    )


@log_router.get("/log", response_model=LogAnswer, responses=documented(404, 422, 503))
async def log(
    state: StateDep,
    axis: AxisFilterDep,
    kind: Annotated[list[str] | None, Query(description="Only of this kind; repeatable.")] = None,
    start_s: Annotated[Moment | None, moment_query("from", "the first event")] = None,
    end_s: Annotated[Moment | None, moment_query("to", "the last event")] = None,
    cursor: Annotated[int | None, Query(ge=1, description="Only events before this one.")] = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="At most this many.")] = 100,
) -> LogAnswer:
    """Events, notes and commands, with who and from where; of an axis also the service's."""
    found = await from_history(
        state.events.page,
        limit + 1,
        axis,
        kind or (),
        0 if start_s is None else round(start_s * 1e9),
        _LAST_NS if end_s is None else round(end_s * 1e9),
        _LAST_NS if cursor is None else cursor,
    )
    asked = {"axis": axis, "kind": kind, "from": start_s, "to": end_s, "limit": limit}
    given = {name: value for name, value in asked.items() if value is not None}
    more = urlencode(given | {"cursor": found[limit - 1].id}, doseq=True) if found[limit:] else ""
    return LogAnswer(
        items=[NumberedEvent(**dict(each.event), id=each.id) for each in found[:limit]],
        next=f"{_PATH}?{more}" if more else None,
    )
