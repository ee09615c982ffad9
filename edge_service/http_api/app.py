"""The application: its routes, the page, and the description of the interface for people.

The description is made here, so that it needs no network.
"""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.responses import HTMLResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException

from .. import __version__
from ..health.service_state import ServiceState
from ..messages.topics import TOPICS
from .context import Clock, known_query
from .guard import LOOPBACK_HOSTS, Authenticator, Guard, authorized, noted
from .problems import DOCUMENTED_DEFAULT, answer_with_problems, problem_schemas
from .routes.axis import axis_router
from .routes.config import config_router
from .routes.history import history_router
from .routes.service import alive_router, service_router
from .routes.work import work_router
from .stream import Encoded, stream_router

STATIC = Path(__file__).parent / "static"
_WORDS = re.compile(r'^  "([^"]+)": (".*"),$', re.MULTILINE)
_FILES = StaticFiles(directory=STATIC)

page_router = APIRouter(include_in_schema=False)


@cache
def words_in(language: str) -> Mapping[str, str]:
    """Text of each key, in a language that the page has."""
    text = (STATIC / "strings" / f"{language}.js").read_text(encoding="utf-8")
    return {key: json.loads(value) for key, value in _WORDS.findall(text)}


@cache
def static_digest() -> str:
    """Digest of all files of the page, which stands in their addresses."""
    digest = hashlib.sha256()
    for path in sorted(STATIC.rglob("*.*")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def tagged(request: Request, content: bytes, media_type: str) -> Response:
    """Content with its tag; nothing but the tag for whoever has it already."""
    tag = f'"{hashlib.sha256(content).hexdigest()[:16]}"'
    headers = {"etag": tag, "cache-control": "no-cache"}
    if tag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(content, media_type=media_type, headers=headers)


@page_router.get("/openapi.json")
def openapi(request: Request) -> Response:
    """The description, for programs."""
    return tagged(request, json.dumps(request.app.openapi()).encode(), "application/json")


@page_router.get("/docs")
def docs(request: Request) -> HTMLResponse:
    """Every route and every shape of `/openapi.json`, for people."""
    return HTMLResponse(rendered(request.app.openapi()))


def rendered(description: dict[str, Any]) -> str:
    """HTML of an OpenAPI description; it loads the style sheet of the page, and nothing else."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup, escape

    def prose(text: str) -> Markup:
        return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["prose"] = prose
    template = files("edge_service.http_api").joinpath("templates", "docs.html").read_text("utf-8")
    return environment.from_string(template).render(
        about=description["info"],
        paths=description["paths"],
        schemas=description["components"]["schemas"],
        digest=static_digest(),
    )


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
    ):
        asked = [Depends(authorized), Depends(known_query)]
        asked += [] if router is axis_router else [Depends(noted)]
        app.include_router(router, dependencies=asked)
    app.add_middleware(Guard, hosts=tuple(hosts))
    return app
