"""The JSON routes."""

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from ...messages.topics import PRELOAD
from ..answers import (
    AliveAnswer,
    AxesAnswer,
    HealthAnswer,
    HistoryAnswer,
    PreloadAnswer,
    ReadyAnswer,
    ServiceAnswer,
)
from ..compose import axes_answer, health_answer, history_answer, preload_answer, service_answer
from ..context import (
    AxisDep,
    Moment,
    NowDep,
    StateDep,
    from_history,
    moment_query,
    parameter_error,
)
from ..problems import documented, problem_response

DEFAULT_SPAN_S = 3600.0
MOST_BUCKETS = 5000
_DEFAULT_BUCKETS = 300

alive_router = APIRouter(tags=["service"])
service_router = APIRouter(tags=["service"])
axis_router = APIRouter(prefix="/api/v1", tags=["axes"])


@alive_router.get("/healthz", response_model=AliveAnswer)
async def alive() -> AliveAnswer:
    """Tell whether the process answers."""
    return AliveAnswer()


@service_router.get("/readyz", response_model=ReadyAnswer, responses=documented(503))
async def ready(request: Request, state: StateDep, now_ns: NowDep) -> ReadyAnswer | Response:
    """Tell whether every axis has fresh input; 503 with reasons if not."""
    reasons = state.unready(now_ns)
    if not reasons:
        return ReadyAnswer()
    detail = "an input is stale or was never received"
    return problem_response(request.url.path, 503, detail, reasons=list(reasons))


@axis_router.get("/health", response_model=ServiceAnswer)
async def service_health(state: StateDep, now_ns: NowDep) -> ServiceAnswer:
    """Health of the whole service."""
    return service_answer(state, now_ns)


@axis_router.get("/axes", response_model=AxesAnswer)
async def axes(state: StateDep, now_ns: NowDep) -> AxesAnswer:
    """All axes, the worst first: condition, what to do, preload, next limit."""
    return axes_answer(state, now_ns)


@axis_router.get("/axes/{axis}/preload", response_model=PreloadAnswer, responses=documented(404))
async def preload(axis: AxisDep, state: StateDep, now_ns: NowDep) -> PreloadAnswer:
    """Preload of one axis; numbers are null, never stale, unless the status is `estimated`."""
    return preload_answer(state, axis, now_ns)


@axis_router.get("/axes/{axis}/health", response_model=HealthAnswer, responses=documented(404))
async def health(axis: AxisDep, state: StateDep, now_ns: NowDep) -> HealthAnswer:
    """Condition of one axis, its components and data faults."""
    return health_answer(state, axis, now_ns)


@axis_router.get(
    "/axes/{axis}/history", response_model=HistoryAnswer, responses=documented(404, 422)
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
) -> HistoryAnswer:
    """History of one axis in buckets; empty buckets are absent, never filled."""
    end_s = now_ns / 1e9 + 1.0 / PRELOAD.rate_hz if end_s is None else end_s
    start_s = max(end_s - DEFAULT_SPAN_S, 0.0) if start_s is None else start_s
    if not start_s < end_s:
        raise parameter_error("from", "must be before `to`")
    step_s = max(1.0, (end_s - start_s) / _DEFAULT_BUCKETS) if step_s is None else step_s
    if (end_s - start_s) / step_s > MOST_BUCKETS:
        raise parameter_error("step", f"would make more than {MOST_BUCKETS} buckets")
    return await from_history(history_answer, state, axis, start_s, end_s, step_s)
