"""The application."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.responses import Response

from .. import __version__
from ..health.service_state import ServiceState
from ..messages.topics import TOPICS
from .access import Authenticator, authorized, noted
from .context import Clock, known_query
from .guard import LOOPBACK_HOSTS, Guard
from .problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_schemas
from .routes.axis import axis_router
from .routes.config import config_router
from .routes.docs import STATIC, docs_router, static_digest, tagged
from .routes.history import history_router
from .routes.service import alive_router, service_router
from .routes.work import work_router
from .stream import Encoded, stream_router

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
    state: ServiceState, clock: Clock, hosts: Iterable[str] = LOOPBACK_HOSTS, **parts: Any
) -> FastAPI:
    """The HTTP interface of one service.

    Args:
        parts: What routes ask by `part(NAME)`; whoever asks for one that is missing gets 503.
            `authenticator` finds who asks, without it whoever reaches the service may do anything;
            `note_change` takes note of a change by its caller, method and path; the others are
            `configurations`, `jobs`, `metrics`, `motions`, `outputs`, `read_stroke`, `recordings`
            and `send_command`.
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
    usual = {
        "authenticator": Authenticator(),
        "note_change": lambda _caller, _action: None,
        "read_stroke": lambda _axis, _preload: None,
    }
    encoded = Encoded(state, parts.get("outputs"))
    own = {"service_state": state, "clock": clock, "readers_of": Counter[str](), "encoded": encoded}
    for name, each in (usual | parts | own).items():
        setattr(app.state, name, each)
    answer_with_problems(app)
    app.include_router(alive_router)
    for router in (
        axis_router,  # whoever does a command tells of it
        config_router,
        history_router,
        service_router,
        stream_router,
        work_router,
        page_router,
        docs_router,
    ):
        asked = [Depends(authorized), Depends(known_query)]
        asked += [] if router is axis_router else [Depends(noted)]
        app.include_router(router, dependencies=asked)
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app
