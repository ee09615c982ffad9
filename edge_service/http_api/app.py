"""The application."""

from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.responses import Response

from .. import __version__
from ..health.service_state import ServiceState
from ..health.store.store import StoreFailedError
from ..messages.topics import TOPICS
from .access import Authenticator, NoteChange, authorized, noted
from .context import Clock, known_query
from .guard import LOOPBACK_HOSTS, SAFE_METHODS, Guard
from .jobs import Jobs
from .problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_response, problem_schemas
from .recordings import Recordings
from .routes.axis import ReadStroke, SendCommand, axis_router
from .routes.config import AxisConfigurations, config_router
from .routes.docs import STATIC, docs_router, static_digest, tagged
from .routes.history import history_router
from .routes.jobs import job_router
from .routes.log import log_router
from .routes.motions import ListMotions, motion_router
from .routes.outputs import OutputDesk, output_router
from .routes.service import alive_router, service_router
from .routes.tokens import token_router
from .stream import stream_router

_FILES = StaticFiles(directory=STATIC)

page_router = APIRouter(include_in_schema=False)


@page_router.get("/")
async def page(request: Request) -> Response:
    """The live page."""
    text = (STATIC / "index.html").read_text("utf-8")
    html = text.replace("/static/", f"/static/{static_digest()}/")
    return tagged(request, html.encode(), "text/html; charset=utf-8")


@page_router.get("/static/{digest}/{path:path}", name="static")
async def static(request: Request, digest: str, path: str) -> Response:
    """A file of the page."""
    if digest != static_digest():
        raise HTTPException(404)
    response = await _FILES.get_response(path, request.scope)
    response.headers["cache-control"] = "max-age=31536000, immutable"
    return response


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The description, with problem documents, tokens, and the payloads of the topics."""
        schema = super().openapi()
        schema["components"]["schemas"].update(problem_schemas())
        schema["components"]["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer"},
            "password": {"type": "http", "scheme": "basic"},
        }
        schema["security"] = [{"token": []}, {"password": []}, {}]
        schema["x-topics"] = {each.schema: each.description() for each in TOPICS.values()}
        return schema


def create_app(
    state: ServiceState,
    clock: Clock,
    hosts: Iterable[str] = LOOPBACK_HOSTS,
    send_command: SendCommand | None = None,
    jobs: Jobs | None = None,
    recordings: Recordings | None = None,
    motions: ListMotions | None = None,
    outputs: OutputDesk | None = None,
    authenticator: Authenticator | None = None,
    note_change: NoteChange = lambda _caller, _action: None,
    metrics: Callable[[], Awaitable[tuple[bytes, str]]] | None = None,
    configurations: AxisConfigurations | None = None,
    read_stroke: ReadStroke = lambda _axis, _preload: None,
) -> FastAPI:
    """The HTTP interface of one service.

    Args:
        state: What is answered from.
        clock: UNIX time in ns.
        hosts: Host names, without port, under which the service may be addressed.
        send_command: Passes on what a person asks of an axis; None: nothing is taken.
        jobs: Runs commands; None: there are none.
        recordings: Those kept here; None: none are.
        motions: Lists the motions of an axis; None: there are none.
        outputs: Knows the queues of the outputs; None: there are none.
        authenticator: Finds who asks; None: whoever reaches the service may do anything.
        note_change: Takes note of a change by its caller, method and path.
        metrics: Answers a scrape by Prometheus; None: there are none.
        configurations: Reads and changes the configuration of axes; None: there is none.
        read_stroke: Reads the profiles along the stroke of an axis.
    """
    app = _Application(
        title="edge-service",
        summary="Ball-screw preload, its uncertainty and the condition of the axis",
        version=__version__,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        responses=DOCUMENTED_DEFAULT,
    )
    app.state.service_state, app.state.clock = state, clock
    app.state.send_command = send_command
    app.state.jobs, app.state.recordings, app.state.motions = jobs, recordings, motions
    app.state.readers_of = Counter[str]()
    app.state.outputs = outputs
    app.state.authenticator = authenticator or Authenticator()
    app.state.note_change = note_change
    app.state.metrics = metrics
    app.state.configurations, app.state.read_stroke = configurations, read_stroke
    app.add_exception_handler(StoreFailedError, on_store_failed)
    answer_with_problems(app)
    app.include_router(alive_router)
    for router in (
        axis_router,  # whoever does a command tells of it
        service_router,
        history_router,
        log_router,
        stream_router,
        page_router,
        docs_router,
    ):
        app.include_router(router, dependencies=[Depends(authorized), Depends(known_query)])
    for router in (config_router, job_router, motion_router, output_router, token_router):
        noting = [Depends(authorized), Depends(known_query), Depends(noted)]
        app.include_router(router, dependencies=noting)
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app


async def on_store_failed(request: Request, error: Exception) -> Response:
    """A store that cannot be read or written now, as a problem document."""
    status = 503 if request.method in SAFE_METHODS else 507
    return problem_response(request.url.path, status, str(error))
