"""Application of a fleet node."""

from collections.abc import Iterable
from pathlib import Path

from fastapi import APIRouter, FastAPI
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles

from ... import __version__
from ..guard import LOOPBACK_HOSTS, Guard
from ..limits.bodies import BodyLimits
from ..limits.head import Head
from ..limits.settings import HttpLimits
from ..problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_schemas
from ..routes.session import session_router
from ..security.doorkeeper import Doorkeeper
from ..security.gate import Gate
from .desk import FleetDesk
from .metrics import fleet_metrics_router
from .rights import FLEET_RIGHTS
from .routes import fleet_router, state_router

STATIC = Path(__file__).parents[1] / "static"
page_router = APIRouter(include_in_schema=False)


@page_router.get("/")
async def page() -> FileResponse:
    """Page of the plant."""
    return FileResponse(STATIC / "fleet.html", headers={"cache-control": "no-cache"})


class _Application(FastAPI):
    def openapi(self) -> dict[str, object]:
        """The description, with the schema of the problem documents."""
        schema = super().openapi()
        schema["components"]["schemas"].update(problem_schemas())
        return schema


def create_fleet_app(
    desk: FleetDesk,
    hosts: Iterable[str] = LOOPBACK_HOSTS,
    doorkeeper: Doorkeeper | None = None,
    limits: HttpLimits | None = None,
) -> FastAPI:
    """The HTTP interface of one fleet node.

    Args:
        desk: what is answered from.
        hosts: host names, without port, under which it may be addressed.
        doorkeeper: tells who asks; None: whoever reaches it may do anything.
        limits: bounds of what is taken from a client.
    """
    app = _Application(
        title="edge-service fleet",
        summary="Every axis of a plant, the worst first",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        responses=DOCUMENTED_DEFAULT,
    )
    app.state.fleet = desk
    app.state.doorkeeper = doorkeeper or Doorkeeper()
    app.state.rights = FLEET_RIGHTS
    answer_with_problems(app)
    for router in (state_router, fleet_router, fleet_metrics_router, session_router, page_router):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    app.add_middleware(BodyLimits, limits=limits or HttpLimits())
    app.add_middleware(Gate, doorkeeper=app.state.doorkeeper, rights=FLEET_RIGHTS)
    app.add_middleware(Head)
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app
