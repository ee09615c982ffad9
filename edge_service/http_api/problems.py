"""Errors as problem documents (RFC 9457), for every status and without a word of a traceback."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import iter_route_contexts
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import compile_path

from ..health.store.store import StoreFailedError

PROBLEM_TYPE = "application/problem+json"
RETRY_S = "5"
"""Time after which a request may succeed that was refused for now."""


class ParameterProblem(BaseModel):
    """Problem with one parameter of a request."""

    parameter: str = Field(examples=["from"])
    detail: str = Field(examples=["'noon' is not a time"])


class Problem(BaseModel):
    """A problem document (RFC 9457)."""

    type: str = Field("about:blank", description="Kind of problem; about:blank: as the status.")
    title: str = Field(description="Words of the HTTP status.", examples=["Not Found"])
    status: int = Field(description="HTTP status.", examples=[404])
    detail: str = Field(description="What was wrong.", examples=["no axis 'Q'; there are X, Y"])
    instance: str = Field(description="Path of the request.", examples=["/api/v1/axes/Q/health"])
    reasons: list[str] | None = Field(None, description="Why the service is not ready.")
    errors: list[ParameterProblem] | None = Field(None, description="Parameters to correct.")


class RefusedError(HTTPException):
    """Refusal of a request: its HTTP status, and one line that says why."""


def problem_response(
    path: str,
    status: int,
    detail: str,
    *,
    headers: Mapping[str, str] | None = None,
    reasons: list[str] | None = None,
    errors: list[ParameterProblem] | None = None,
) -> JSONResponse:
    """A problem document as a response."""
    problem = Problem(
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        instance=path,
        reasons=reasons,
        errors=errors,
    )
    again = {"retry-after": RETRY_S} if status in (429, 503) else {}
    content = problem.model_dump(exclude_none=True)
    return JSONResponse(content, status, {**again, **(headers or {})}, PROBLEM_TYPE)


_DOCUMENTED = {PROBLEM_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
DOCUMENTED_DEFAULT: dict[int | str, dict[str, Any]] = {
    "default": {"description": "Problem document (RFC 9457)", "content": _DOCUMENTED}
}
"""The `responses` of every route."""


def problem_schemas() -> dict[str, Any]:
    """Schemas of a problem document, for the components of the description."""
    schema = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    parts: dict[str, Any] = schema.pop("$defs", {})
    return parts | {"Problem": schema}


def answer_with_problems(app: FastAPI) -> None:
    """Let the application answer every error with a problem document."""
    app.add_exception_handler(HTTPException, _on_http_error)
    app.add_exception_handler(RequestValidationError, _on_bad_request)
    for kind in (ClientDisconnect, StoreFailedError, Exception):
        app.add_exception_handler(kind, _on_failure)


async def _on_http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    plain = error.detail == HTTPStatus(error.status_code).phrase
    detail = _PLAIN_DETAIL.get(error.status_code, error.detail) if plain else error.detail
    path, headers = request.url.path, error.headers
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        methods = {
            method
            for route in iter_route_contexts(request.app.routes)
            if route.path and compile_path(route.path)[0].match(request.url.path)
            for method in route.methods or ()
        }
        allowed = ", ".join(sorted(methods | ({"HEAD"} if "GET" in methods else set())))
        headers = {"allow": allowed}
    return problem_response(path, error.status_code, detail, headers=headers)


async def _on_bad_request(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    if error.body and isinstance(error.body, bytes):  # it was not even read as JSON
        kind = request.headers.get("content-type", "")
        words = f"content-type: expected application/json, got {kind[:100]!r}"
        return problem_response(request.url.path, 415, words)
    errors = [
        ParameterProblem(
            parameter=str(item["loc"][-1]), detail=str(item["msg"]).removeprefix("Value error, ")
        )
        for item in error.errors()
    ]
    detail = "; ".join(f"{each.parameter}: {each.detail}" for each in errors)
    return problem_response(request.url.path, 422, detail, errors=errors)


async def _on_failure(request: Request, error: Exception) -> JSONResponse:
    status, words = 500, "the service failed; see its log for the reason"
    if isinstance(error, StoreFailedError):
        status, words = 503 if request.method in ("GET", "HEAD") else 507, str(error)
    elif isinstance(error, ClientDisconnect):
        status, words = 400, "the client left before the end of its request"
    return problem_response(request.url.path, status, words)


_PLAIN_DETAIL = {
    404: "there is nothing at this path; /openapi.json lists what there is",
    405: "this path does not support this method",
}
