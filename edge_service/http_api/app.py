"""The application."""

from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles
from starlette.responses import Response

from .. import __version__
from ..health.service_state import ServiceState
from ..health.store.store import StoreFailedError
from .access import Authenticator, NoteChange, authorized, noted
from .context import Clock
from .guard import LOOPBACK_HOSTS, SAFE_METHODS, Guard
from .jobs import Jobs
from .problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_response, problem_schemas
from .recordings import Recordings, RefusedError
from .routes.axis import SendCommand, work_router
from .routes.docs import docs_router
from .routes.history import history_router
from .routes.jobs import job_router, on_refused
from .routes.log import log_router
from .routes.motions import ListMotions, motion_router
from .routes.outputs import OutputDesk, output_router
from .routes.preload import alive_router, axis_router, service_router
from .routes.schemas import schema_router
from .routes.tokens import token_router
from .stream import stream_router

STATIC = Path(__file__).with_name("static")
_FILES = StaticFiles(directory=STATIC)

page_router = APIRouter(include_in_schema=False)


@page_router.get("/")
async def dashboard() -> FileResponse:
    """The live page."""
    return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})


@page_router.get("/static/{path:path}", name="static")
async def static(request: Request, path: str) -> Response:
    """A file of the page."""
    return await _FILES.get_response(path, request.scope)


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The description, with the schema of the problem documents and the tokens."""
        schema = super().openapi()
        schema["components"]["schemas"].update(problem_schemas())
        schema["components"]["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer"},
            "password": {"type": "http", "scheme": "basic"},
        }
        schema["security"] = [{"token": []}, {"password": []}, {}]
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
    app.state.service_state = state
    app.state.clock = clock
    app.state.send_command = send_command
    app.state.jobs, app.state.recordings, app.state.motions = jobs, recordings, motions
    app.state.readers_of = Counter[str]()
    app.state.outputs = outputs
    app.state.authenticator = authenticator or Authenticator()
    app.state.note_change = note_change
    app.state.metrics = metrics
    app.add_exception_handler(RefusedError, on_refused)
    app.add_exception_handler(StoreFailedError, on_store_failed)
    answer_with_problems(app)
    app.include_router(alive_router)
    for router in (
        service_router,
        axis_router,
        work_router,
        history_router,
        log_router,
        schema_router,
        stream_router,
        page_router,
        docs_router,
    ):
        app.include_router(router, dependencies=[Depends(authorized)])
    for router in (job_router, motion_router, output_router, token_router):
        app.include_router(router, dependencies=[Depends(authorized), Depends(noted)])
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app


async def on_store_failed(request: Request, error: Exception) -> Response:
    """A store that cannot be read or written now, as a problem document."""
    status = 503 if request.method in SAFE_METHODS else 507
    return problem_response(request.url.path, status, str(error))
