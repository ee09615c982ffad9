"""The application."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles

from .. import __version__
from ..health.service_state import ServiceState
from .context import Clock
from .guard import LOOPBACK_HOSTS, Guard
from .jobs import JobDesk, RefusedError
from .limits.bodies import BodyLimits
from .limits.head import Head
from .limits.settings import HttpLimits
from .metrics import metrics_router
from .outputs import OutputDesk
from .problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_schemas
from .routes.audit import audit_router
from .routes.axis import SendCommand, work_router
from .routes.diagnose import diagnose_router
from .routes.docs import docs_router
from .routes.download import download_router
from .routes.jobs import job_router, on_refused
from .routes.motions import MotionDesk, motion_router
from .routes.outputs import output_router
from .routes.preload import axis_router, service_router
from .routes.schemas import schema_router
from .routes.session import session_router
from .security.doorkeeper import Doorkeeper
from .security.gate import Gate
from .security.trail import Trail
from .stream import stream_router

STATIC = Path(__file__).with_name("static")

page_router = APIRouter(include_in_schema=False)


@page_router.get("/")
async def dashboard() -> FileResponse:
    """The live page."""
    return FileResponse(STATIC / "index.html", headers={"cache-control": "no-cache"})


class _Application(FastAPI):
    def openapi(self) -> dict[str, Any]:
        """The description, with the schema of the problem documents and the tokens."""
        schema = super().openapi()
        schema["components"]["schemas"].update(problem_schemas())
        schema["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        schema["security"] = [{"token": []}, {}]
        return schema


def create_app(
    state: ServiceState,
    clock: Clock,
    hosts: Iterable[str] = LOOPBACK_HOSTS,
    send_command: SendCommand | None = None,
    desk: JobDesk | None = None,
    limits: HttpLimits | None = None,
    outputs: OutputDesk | None = None,
    doorkeeper: Doorkeeper | None = None,
    motion_desk: MotionDesk | None = None,
) -> FastAPI:
    """The HTTP interface of one service.

    Args:
        state: What is answered from.
        clock: UNIX time in ns.
        hosts: Host names, without port, under which the service may be addressed.
        send_command: Passes on what a person asks of an axis; None: nothing is taken.
        desk: Keeps recordings and runs jobs; None: there are none.
        limits: Bounds of what is taken from a client.
        outputs: Keeps dead letters; None: there are none.
        doorkeeper: Tells who asks; None: whoever reaches the service may do anything.
        motion_desk: Writes motions and records axes; None: there is none.
    """
    app = _Application(
        title="edge-service",
        summary="Ball-screw preload, its uncertainty and the condition of the axis",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        responses=DOCUMENTED_DEFAULT,
    )
    app.state.service_state = state
    app.state.clock = clock
    app.state.send_command = send_command
    app.state.desk = desk
    app.state.motion_desk = motion_desk
    app.state.readers_of = Counter[str]()
    app.state.outputs = outputs
    app.state.doorkeeper = doorkeeper or Doorkeeper()
    app.add_exception_handler(RefusedError, on_refused)
    answer_with_problems(app)
    for router in (
        service_router,
        axis_router,
        work_router,
        download_router,
        job_router,
        motion_router,
        output_router,
        diagnose_router,
        schema_router,
        audit_router,
        stream_router,
        metrics_router,
        session_router,
        page_router,
        docs_router,
    ):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_middleware(BodyLimits, limits=limits or HttpLimits())
    app.add_middleware(Gate, doorkeeper=app.state.doorkeeper)
    app.add_middleware(Trail, state=state, clock=clock)
    app.add_middleware(Head)
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app
