"""Dependencies of the routes: the board, the time, and parameters that make sense."""

from collections.abc import Callable
from typing import Annotated

from fastapi import Depends, Query, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BeforeValidator
from starlette.exceptions import HTTPException

from ..health.service_state import Board
from .times import parse_moment

Clock = Callable[[], int]
Moment = Annotated[float, BeforeValidator(parse_moment, json_schema_input_type=str)]


async def board_of(request: Request) -> Board:
    """The board that the application was made with."""
    board: Board = request.app.state.board
    return board


async def clock_of(request: Request) -> Clock:
    """The clock that the application was made with: UNIX time in ns."""
    clock: Clock = request.app.state.clock
    return clock


async def now_of(clock: Annotated[Clock, Depends(clock_of)]) -> int:
    """UNIX time of the request, ns."""
    return clock()


BoardDep = Annotated[Board, Depends(board_of)]
NowDep = Annotated[int, Depends(now_of)]


def check_axis(board: Board, axis: str) -> str:
    """The axis, if there is one of that name."""
    if axis not in board.axes:
        there = ", ".join(board.axes) or "none"
        raise HTTPException(404, f"no axis {axis!r}; there are: {there}")
    return axis


async def known_axis(axis: str, board: BoardDep) -> str:
    """The axis of the path."""
    return check_axis(board, axis)


async def known_axis_filter(
    board: BoardDep,
    axis: Annotated[str | None, Query(description="Only what concerns this axis.")] = None,
) -> str | None:
    """The axis of the query, if there is one."""
    return None if axis is None else check_axis(board, axis)


AxisDep = Annotated[str, Depends(known_axis)]
AxisFilterDep = Annotated[str | None, Depends(known_axis_filter)]


def parameter_error(parameter: str, message: str) -> RequestValidationError:
    """An error that names a parameter of the query."""
    return RequestValidationError(
        [{"type": "value_error", "loc": ("query", parameter), "msg": message}]
    )
