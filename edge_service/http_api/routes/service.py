"""Routes of the service as a whole: alive, ready, metrics, its parts and its axes."""

from fastapi import APIRouter, Request
from fastapi.responses import Response
from pydantic import Field
from starlette.exceptions import HTTPException

from ... import __version__
from ...health.service_state import ServiceState
from ...messages.answer import AxesAnswer, axis_row
from ...messages.health import ComponentHealth
from ..answers import Answer, Timestamp
from ..context import NowDep, StateDep
from ..problems import documented, problem_response
from .outputs import OutputAnswer, output_items

alive_router = APIRouter(tags=["service"])
service_router = APIRouter(tags=["service"])


class AliveAnswer(Answer):
    """The process answers."""

    alive: bool = True


class ReadyAnswer(Answer):
    """The service can answer for every axis."""

    ready: bool = True


class ServiceAnswer(Answer):
    """Health of the whole service."""

    time: Timestamp = Field(description="Time of this answer, by the clock of the service.")
    ready: bool
    reasons: list[str] = Field(description="Why the service is not ready, per axis.")
    version: str = Field(description="Version of edge-service.")
    configuration: str = Field(
        description="Digest of the configuration that it was started with; empty without a file."
    )
    site: str
    machine: str
    store: str = Field(description="Where and how long history is kept.")
    components: list[ComponentHealth] = Field(description="All parts; those of an axis name it.")
    outputs: list[OutputAnswer]


@alive_router.get("/healthz", response_model=AliveAnswer)
async def alive() -> AliveAnswer:
    """The process answers."""
    return AliveAnswer()


@service_router.get("/readyz", response_model=ReadyAnswer, responses=documented(503))
async def ready(request: Request, state: StateDep, now_ns: NowDep) -> ReadyAnswer | Response:
    """Every axis has fresh input; 503 with reasons if not."""
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


@service_router.get("/api/v1/health", response_model=ServiceAnswer)
async def service_health(request: Request, state: StateDep, now_ns: NowDep) -> ServiceAnswer:
    """Health of the whole service: is it ready, its parts, its outputs."""
    outputs = await output_items(state, now_ns, request.app.state.outputs)
    return service_answer(state, now_ns, outputs)


def service_answer(state: ServiceState, now_ns: int, outputs: list[OutputAnswer]) -> ServiceAnswer:
    """Health of the service, with that of its outputs."""
    reasons = state.unready(now_ns)
    return ServiceAnswer(
        time=now_ns,
        ready=not reasons,
        reasons=list(reasons),
        version=__version__,
        configuration=state.configuration,
        site=state.place.site,
        machine=state.place.machine,
        store=state.kept,
        components=list(state.all_components(now_ns)),
        outputs=outputs,
    )


@service_router.get("/api/v1/axes", response_model=AxesAnswer)
async def axes(state: StateDep, now_ns: NowDep) -> AxesAnswer:
    """All axes, the worst first: condition, what to do, preload, next limit."""
    rows = [axis_row(state.health(axis, now_ns), now_ns) for axis in state.axes]
    return AxesAnswer(
        site=state.place.site,
        machine=state.place.machine,
        axes=tuple(sorted(rows, key=lambda row: row.urgency)),
    )
