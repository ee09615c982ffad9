"""The description of the interface as a page, made here so that it needs no network; its words."""

import hashlib
import json
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

STATIC = Path(__file__).parents[1] / "static"
_WORDS = re.compile(r'^  "([^"]+)": (".*"),$', re.MULTILINE)
docs_router = APIRouter(include_in_schema=False)


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


@docs_router.get("/openapi.json")
def openapi(request: Request) -> Response:
    """The description, for programs."""
    return tagged(request, json.dumps(request.app.openapi()).encode(), "application/json")


@docs_router.get("/docs")
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
