"""Routes by which a browser signs in and out."""

from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from ..answers import Answer
from ..problems import documented
from ..security.access import RIGHTS, Rights, Role
from ..security.doorkeeper import Doorkeeper, Identity, LimitedError
from ..security.gate import cookie_name, credentials, identity_of
from ..security.sessions import LIFETIME_S
from ..security.trail import signed_in

session_router = APIRouter(prefix="/api/v1", tags=["service"])


class SignInBody(BaseModel):
    """A token, as `edge-service token add` has printed it."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"token": "edge-…"}]})

    token: str = Field(min_length=1, max_length=200)


class SessionAnswer(Answer):
    """Answer with the name and role of the asker."""

    required: bool = Field(description="Whether this service asks for tokens at all.")
    name: str | None = Field(description="Name of the token; null if none was sent.")
    role: str = Field(examples=["operator"], description="What the caller may do.")
    rights: dict[str, dict[str, str]] = Field(
        examples=[{"/api/v1/audit": {"GET": "operator"}}],
        description="Path -> method -> the least role; empty for whoever is not signed in.",
    )


async def doorkeeper_of(request: Request) -> Doorkeeper:
    """The doorkeeper of the application."""
    doorkeeper: Doorkeeper = request.app.state.doorkeeper
    return doorkeeper


DoorkeeperDep = Annotated[Doorkeeper, Depends(doorkeeper_of)]


@session_router.get("/session", response_model=SessionAnswer)
async def session(request: Request) -> SessionAnswer:
    """Tell who asks, and whether a token is needed."""
    return _answer(request, identity_of(request))


@session_router.post("/session", response_model=SessionAnswer, responses=documented(401, 422, 429))
async def sign_in(
    request: Request, response: Response, body: SignInBody, doorkeeper: DoorkeeperDep
) -> SessionAnswer:
    """Begin the session of a browser with a token; it lasts 12 h at most."""
    if doorkeeper.tokens is None:
        return _answer(request, identity_of(request))
    client = request.client.host if request.client else "?"
    try:
        identity, secret = doorkeeper.sign_in(body.token.strip(), client)
    except LimitedError as error:
        wait = {"retry-after": str(round(error.wait_s) + 1)}
        raise HTTPException(429, str(error), headers=wait) from None
    except PermissionError:
        raise HTTPException(401, "this token is unknown or has expired") from None
    signed_in(request, identity.name)
    _set_cookie(request, response, secret, LIFETIME_S)
    return _answer(request, identity)


@session_router.delete("/session", status_code=204)
async def sign_out(request: Request, doorkeeper: DoorkeeperDep) -> Response:
    """End the session of a browser."""
    _, secret = credentials(request)
    doorkeeper.sign_out(secret)
    response = Response(status_code=204)
    _set_cookie(request, response, "", 0)
    return response


def _set_cookie(request: Request, response: Response, secret: str, age_s: float) -> None:
    """Let the browser hold a secret that no script and no other site can use."""
    response.set_cookie(
        cookie_name(request.scope),
        secret,
        max_age=round(age_s),
        secure=request.url.scheme == "https",
        httponly=True,
        samesite="strict",
    )


def _answer(request: Request, identity: Identity) -> SessionAnswer:
    rights: Rights = getattr(request.app.state, "rights", RIGHTS)
    return SessionAnswer(
        required=request.app.state.doorkeeper.tokens is not None,
        name=identity.name,
        role=_shown(identity.role),
        rights={} if identity.role is Role.NOBODY else _named(rights),
    )


def _named(rights: Rights) -> dict[str, dict[str, str]]:
    return {
        path: {method: _shown(role) for method, role in methods.items()}
        for path, methods in rights.routes.items()
    }


def _shown(role: Role) -> str:
    return role.name.lower()
