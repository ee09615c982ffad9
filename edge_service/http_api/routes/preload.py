"""The JSON routes."""

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from ..answers import (
    AliveAnswer,
    AxesAnswer,
    HealthAnswer,
    PreloadAnswer,
    ReadyAnswer,
    ServiceAnswer,
)
from ..compose import axes_answer, health_answer, preload_answer, service_answer
from ..context import AxisDep, NowDep, StateDep
from ..problems import documented, problem_response

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


@service_router.get("/metrics", response_class=Response, responses=documented(404))
async def metrics(request: Request) -> Response:
    """Metrics in the text format of Prometheus; a number that does not exist has no sample."""
    if request.app.state.metrics is None:
        raise HTTPException(404, "the output `metrics` is not installed")
    text, content_type = await request.app.state.metrics()
    return Response(text, media_type=content_type)


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
