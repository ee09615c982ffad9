"""History to take along: one row per estimate, minute or hour, as CSV, Parquet or Arrow."""

from enum import StrEnum
from typing import Annotated

from fastapi import APIRouter
from fastapi.responses import Response

from ...health.history.parquet import as_bytes
from ...health.service_state import ServiceState
from ..context import (
    AxisDep,
    Moment,
    NowDep,
    StateDep,
    from_history,
    moment_query,
    parameter_error,
)
from ..problems import documented

_MOST_ROWS = 300_000
_SPAN_S = 86400.0
_STEPS_S = (0.1, 60.0, 3600.0)
_TYPES = {
    "csv": "text/csv",
    "parquet": "application/vnd.apache.parquet",
    "arrow": "application/vnd.apache.arrow.file",
}

download_router = APIRouter(prefix="/api/v1/axes/{axis}", tags=["axes"])


class Form(StrEnum):
    """File format of a download."""

    CSV = "csv"
    PARQUET = "parquet"
    ARROW = "arrow"


@download_router.get(
    "/history.{form}",
    response_class=Response,
    responses=documented(404, 422) | {200: {"content": {each: {} for each in _TYPES.values()}}},
)
async def history_file(
    *,
    axis: AxisDep,
    form: Form,
    state: StateDep,
    now_ns: NowDep,
    start_s: Annotated[Moment | None, moment_query("from", "24 h before `to`")] = None,
    end_s: Annotated[Moment | None, moment_query("to", "now")] = None,
) -> Response:
    """History as a file: every estimate of up to 8 h, minutes of up to 200 days, hours beyond."""
    end_s = now_ns / 1e9 if end_s is None else end_s
    start_s = max(end_s - _SPAN_S, 0.0) if start_s is None else start_s
    if not start_s < end_s:
        raise parameter_error("from", "must be before `to`")
    content = await from_history(_content, state, axis, form, start_s, end_s)
    name = f"preload_{axis}.{form.value}"
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=_TYPES[form.value], headers=headers)


def _content(state: ServiceState, axis: str, form: Form, start_s: float, end_s: float) -> bytes:
    span_s = end_s - start_s
    step_s = next((each for each in _STEPS_S if span_s / each <= _MOST_ROWS), _STEPS_S[-1])
    rows = state.history_rows(axis, start_s, end_s, step_s)
    return as_bytes(rows, form.value)
