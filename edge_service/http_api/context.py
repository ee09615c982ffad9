"""Dependencies of the routes: the service state, the time, and parameters that make sense."""

import asyncio
from collections.abc import Callable
from typing import Annotated, Any, ParamSpec, TypeVar

from fastapi import Depends, Query, Request, params
from fastapi.dependencies.utils import get_flat_params
from fastapi.exceptions import RequestValidationError
from pydantic import BeforeValidator, WithJsonSchema
from starlette.exceptions import HTTPException

from ..health.service_state import ServiceState
from ..health.store.store import StoreFailedError
from ..messages.interval import LAST_S, parse_moment
from ..threads import Threads

Given = ParamSpec("Given")
Answer = TypeVar("Answer")
Clock = Callable[[], int]
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


async def state_of(request: Request) -> ServiceState:
    """The state that the application was made with."""
    state: ServiceState = request.app.state.service_state
    return state


async def clock_of(request: Request) -> Clock:
    """The clock that the application was made with: UNIX time in ns."""
    clock: Clock = request.app.state.clock
    return clock


async def now_of(clock: Annotated[Clock, Depends(clock_of)]) -> int:
    """UNIX time of the request, ns."""
    return clock()


StateDep = Annotated[ServiceState, Depends(state_of)]
NowDep = Annotated[int, Depends(now_of)]


def check_axis(state: ServiceState, axis: str) -> str:
    """The axis, if there is one of that name."""
    if axis not in state.axes:
        there = ", ".join(state.axes) or "none"
        raise HTTPException(404, f"no axis {axis!r}; there are: {there}")
    return axis


async def known_axis(axis: str, state: StateDep) -> str:
    """The axis of the path."""
    return check_axis(state, axis)


async def known_axis_filter(
    state: StateDep,
    axis: Annotated[str | None, Query(description="Only what concerns this axis.")] = None,
) -> str | None:
    """The axis of the query, if there is one."""
    return None if axis is None else check_axis(state, axis)


AxisDep = Annotated[str, Depends(known_axis)]
AxisFilterDep = Annotated[str | None, Depends(known_axis_filter)]


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


async def from_history(
    ask: Callable[Given, Answer], *args: Given.args, **kwargs: Given.kwargs
) -> Answer:
    """Answer of a question to the history, which reads files; 503 where that fails."""
    try:
        async with asyncio.timeout(_ANSWER_S):
            return await QUESTIONS.run(ask, *args, **kwargs)
    except TimeoutError:
        raise HTTPException(503, "the disk with the history does not answer") from None
    except (OSError, StoreFailedError) as error:
        raise HTTPException(503, f"the history cannot be read now ({error})") from None
