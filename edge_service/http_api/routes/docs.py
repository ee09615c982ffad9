"""The description of the interface as a page: made here, so that it needs no network."""

import re
from importlib.resources import files
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, JSONResponse

docs_router = APIRouter(include_in_schema=False)


@docs_router.get("/openapi.json")
def openapi(request: Request) -> JSONResponse:
    """The description, for programs."""
    return JSONResponse(request.app.openapi())


@docs_router.get("/docs")
def docs(request: Request) -> HTMLResponse:
    """Every route and every shape of `/openapi.json`, for people."""
    return HTMLResponse(rendered(request.app.openapi()))


def rendered(description: dict[str, Any]) -> str:
    """HTML of an OpenAPI description; it loads the style sheet of the page, and nothing else."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup, escape

    def prose(text: str) -> Markup:
        """Text with its `code` marked as such."""
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
    )
