"""Parts of the application, an axis, times and pages, for routes; nothing unknown is taken."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Generic, ParamSpec, TypeVar

from fastapi import Depends, Query, Request, params
from fastapi.dependencies.utils import get_flat_params
from fastapi.exceptions import RequestValidationError
from pydantic import BeforeValidator, Field, WithJsonSchema
from starlette.exceptions import HTTPException

from ..health.service_state import ServiceState
from ..health.store.store import StoreFailedError
from ..messages.interval import LAST_S, Frozen, parse_moment
from ..threads import Threads

Given = ParamSpec("Given")
T = TypeVar("T")
Clock = Callable[[], int]
_LAST = 2**63 - 1
Moment = Annotated[
    float,
    BeforeValidator(parse_moment),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "format": "date-time", "pattern": r"^(19[7-9]\d|[2-9]\d{3})-"},
                {"type": "number", "minimum": 0.0, "maximum": LAST_S},
            ]
        }
    ),
]
"""RFC 3339 or UNIX s."""


def part(name: str) -> Any:
    """Dependency on a part that the application was made with; 503 without it."""

    async def found(request: Request) -> Any:
        there = getattr(request.app.state, name, None)
        if there is None:
            raise HTTPException(503, f"this service has no {name.replace('_', ' ')}")
        return there

    return Depends(found)


StateDep = Annotated[ServiceState, part("service_state")]
ClockDep = Annotated[Clock, part("clock")]


async def now_of(clock: ClockDep) -> int:
    """UNIX time of the request, ns."""
    return clock()


NowDep = Annotated[int, Depends(now_of)]


async def known_axis(axis: str, state: StateDep) -> str:
    """The axis of the path, if there is one of that name."""
    if axis not in state.axes:
        there = ", ".join(state.axes) or "none"
        raise HTTPException(404, f"no axis {axis!r}; there are: {there}")
    return axis


async def known_axis_filter(
    state: StateDep,
    axis: Annotated[str | None, Query(description="Only what concerns this axis.")] = None,
) -> str | None:
    """The axis of the query, if there is one."""
    return None if axis is None else await known_axis(axis, state)


AxisDep = Annotated[str, Depends(known_axis)]
AxisFilterDep = Annotated[str | None, Depends(known_axis_filter)]


class Page(Frozen, Generic[T]):
    """Part of a list, newest first."""

    items: list[T]
    next: str | None = Field(
        description="Address of the older ones; null at the end.",
        examples=["/api/v1/log?cursor=1795000000000000&limit=100"],
    )


class Paging:
    """Page of a list that a request asks for."""

    def __init__(
        self,
        request: Request,
        cursor: Annotated[
            int, Query(ge=1, le=_LAST, description="As in `next` of the page before.")
        ] = _LAST,
        limit: Annotated[int, Query(ge=1, le=1000, description="At most this many.")] = 100,
    ) -> None:
        self.before, self.limit = cursor, limit
        self._url = request.url

    def page(self, found: Sequence[T], cursors: Sequence[int]) -> Page[T]:
        """Page of what was found before the cursor, one more than the limit if there is one."""
        more = None
        if found[self.limit :]:
            url = self._url.include_query_params(cursor=cursors[self.limit - 1])
            more = f"{url.path}?{url.query}"
        return Page(items=[*found[: self.limit]], next=more)


PagingDep = Annotated[Paging, Depends()]


def moment_query(alias: str, default: str) -> Any:
    """Query parameter that is a time."""
    return Query(alias=alias, description=f"RFC 3339 or UNIX s; default: {default}.")


def parameter_error(parameter: str, message: str) -> RequestValidationError:
    """An error that names a parameter of the query."""
    return RequestValidationError(
        [{"type": "value_error", "loc": ("query", parameter), "msg": message}]
    )


async def known_query(request: Request) -> None:
    """Refuse parameters of the query that the route does not know."""
    declared = get_flat_params(request.scope["route"].dependant)
    known = {each.alias for each in declared if isinstance(each.field_info, params.Query)}
    for name in request.query_params:
        if name not in known:
            there = ", ".join(sorted(known)) or "none"
            raise parameter_error(name, f"unknown parameter; there are: {there}")


QUESTIONS = Threads("question", 8)
"""Readers of files for requests: a disk that hangs holds up no more of them."""
_ANSWER_S = 30.0


async def from_history(ask: Callable[Given, T], *args: Given.args, **kwargs: Given.kwargs) -> T:
    """Answer of a question to the history, which reads files; 503 where that fails."""
    try:
        async with asyncio.timeout(_ANSWER_S):
            return await QUESTIONS.run(ask, *args, **kwargs)
    except TimeoutError:
        raise HTTPException(503, "the disk with the history does not answer") from None
    except (OSError, StoreFailedError) as error:
        raise HTTPException(503, f"the history cannot be read now ({error})") from None
