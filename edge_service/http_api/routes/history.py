"""History of an axis: buckets of any span, or every row of it as a file."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from typing import IO, Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response, StreamingResponse
from pydantic import Field

from ...health.service_state import ServiceState
from ...health.store.history import HistoryForm, write_history
from ...health.store.rows import Bucket
from ...health.store.store import StoreFailedError
from ...messages.interval import Frozen, TimeNs, parse_moment
from ...messages.topics import PRELOAD
from ..context import (
    AxisDep,
    Moment,
    NowDep,
    StateDep,
    from_history,
    moment_query,
    parameter_error,
)

DEFAULT_SPAN_S = 3600.0
MOST_BUCKETS = 5000
_DEFAULT_BUCKETS = 300
_TYPES: dict[HistoryForm, str] = {
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
}
_CHUNK_BYTES = 1 << 16
_PARAMETERS = ("from", "to", "step")

history_router = APIRouter(prefix="/api/v1", tags=["axes"])


class HistoryAnswer(Frozen):
    """History of one axis in buckets, oldest first; empty buckets are absent."""

    axis: str
    from_ns: TimeNs = Field(alias="from")
    to_ns: TimeNs = Field(alias="to")
    step_s: float = Field(description="Length of a bucket, s.")
    buckets: tuple[Bucket, ...]


@history_router.get(
    "/axes/{axis}/history",
    response_model=HistoryAnswer,
    responses={200: {"content": {each: {} for each in _TYPES.values()}}},
)
async def history(
    *,
    axis: AxisDep,
    state: StateDep,
    now_ns: NowDep,
    start_s: Annotated[Moment | None, moment_query("from", "one hour before `to`")] = None,
    end_s: Annotated[Moment | None, moment_query("to", "now")] = None,
    step_s: Annotated[
        float | None,
        Query(alias="step", gt=0.0, allow_inf_nan=False, description="Length of a bucket, s."),
    ] = None,
    form: Annotated[
        Literal["json", "csv", "parquet"],
        Query(alias="format", description="Buckets, or a file with every row."),
    ] = "json",
) -> HistoryAnswer | Response:
    """History of one axis in buckets; empty ones are absent, never filled. A file has every row."""
    if form == "json":
        return await from_history(buckets_answer, state, axis, now_ns, start_s, end_s, step_s)
    if step_s is not None:
        raise parameter_error("step", f"has no meaning for {form}: it has every row")
    file = await from_history(_file, state, axis, form, *_span(now_ns, start_s, end_s))
    name = f"preload_{axis}.{form}"
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return StreamingResponse(_chunks(file), media_type=_TYPES[form], headers=headers)


def buckets_answer(
    state: ServiceState,
    axis: str,
    now_ns: int,
    start_s: float | None,
    end_s: float | None,
    step_s: float | None,
) -> HistoryAnswer:
    """Buckets of a span. Raises RequestValidationError, StoreFailedError."""
    start_s, end_s = _span(now_ns, start_s, end_s)
    step_s = max(1.0, (end_s - start_s) / _DEFAULT_BUCKETS) if step_s is None else step_s
    if (end_s - start_s) / step_s > MOST_BUCKETS:
        raise parameter_error("step", f"would make more than {MOST_BUCKETS} buckets")
    return HistoryAnswer(
        axis=axis,
        from_ns=round(start_s * 1e9),
        to_ns=round(end_s * 1e9),
        step_s=step_s,
        buckets=state.history.buckets(axis, start_s, end_s, step_s),
    )


def answer_selector(state: ServiceState, axis: str, selector: str, now_ns: int) -> bytes:
    """Buckets as JSON for the parameters of a selector; `{"detail": ...}` where they are wrong."""
    try:
        given = dict(each.partition("=")[::2] for each in selector.split(";") if each)
        if unknown := set(given) - set(_PARAMETERS):
            raise ValueError(f"{min(unknown)}: unknown; there are {', '.join(_PARAMETERS)}")
        start_s, end_s = (
            parse_moment(given[name]) if name in given else None for name in _PARAMETERS[:2]
        )
        step_s = float(given["step"]) if "step" in given else None
        if step_s is not None and not 0.0 < step_s < float("inf"):
            raise ValueError(f"step: {step_s:g}, expected more than 0")
        found = buckets_answer(state, axis, now_ns, start_s, end_s, step_s)
        return found.model_dump_json().encode()
    except RequestValidationError as error:
        first = error.errors()[0]
        detail = f"{first['loc'][-1]}: {first['msg']}"
    except (ValueError, StoreFailedError) as error:
        detail = str(error)
    return json.dumps({"detail": detail}).encode()


def _span(now_ns: int, start_s: float | None, end_s: float | None) -> tuple[float, float]:
    end_s = now_ns / 1e9 + 1.0 / PRELOAD.rate_hz if end_s is None else end_s
    start_s = max(end_s - DEFAULT_SPAN_S, 0.0) if start_s is None else start_s
    if not start_s < end_s:
        raise parameter_error("from", "must be before `to`")
    return start_s, end_s


def _file(
    state: ServiceState, axis: str, form: HistoryForm, start_s: float, end_s: float
) -> IO[bytes]:
    """Temporary file with every row; it is gone once it is closed."""
    with ExitStack() as stack:
        file = stack.enter_context(tempfile.TemporaryFile())
        write_history(file, form, state.history, (axis,), start_s, end_s)
        file.seek(0)
        stack.pop_all()
        return file


def _chunks(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while content := file.read(_CHUNK_BYTES):
            yield content
