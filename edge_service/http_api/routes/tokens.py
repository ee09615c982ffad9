"""Routes of the tokens that let people and programs in."""

from fastapi import APIRouter, Request
from pydantic import Field
from starlette.exceptions import HTTPException

from ...health.store.tokens import MOST_LETTERS, NAME, Role, TokenError, Tokens
from ..access import Authenticator, CallerDep
from ..answers import Answer, Timestamp
from ..context import QUESTIONS, NowDep
from ..problems import documented

token_router = APIRouter(prefix="/api/v1/tokens", tags=["service"])


class TokenAnswer(Answer):
    """One token, without its secret."""

    name: str = Field(examples=["kim"])
    role: Role
    created_at: Timestamp = Field(validation_alias="created_ns")
    used_at: Timestamp | None = Field(
        validation_alias="used_ns", description="Last use, to some ten minutes; null before it."
    )


class CallerAnswer(Answer):
    """Whoever asks."""

    name: str | None = Field(description="Name of the token; null where none is needed.")
    role: Role


class TokensAnswer(Answer):
    """All tokens by name."""

    items: list[TokenAnswer]
    caller: CallerAnswer


class TokenBody(Answer):
    """Request for a token."""

    name: str = Field(pattern=NAME, max_length=MOST_LETTERS, examples=["kim"])
    role: Role


class NewTokenAnswer(TokenBody):
    """A token that was made."""

    token: str = Field(description="The token; it is shown only here.")


def _tokens(request: Request) -> tuple[Authenticator, Tokens]:
    authenticator: Authenticator = request.app.state.authenticator
    if authenticator.tokens is None:
        raise HTTPException(503, "this service keeps no tokens")
    return authenticator, authenticator.tokens


@token_router.get("", response_model=TokensAnswer)
async def listed(request: Request, caller: CallerDep) -> TokensAnswer:
    """List the tokens with their roles, and tell who asks."""
    tokens = request.app.state.authenticator.tokens
    found = () if tokens is None else await QUESTIONS.run(tokens.all)
    return TokensAnswer(
        items=[TokenAnswer.model_validate(each) for each in found],
        caller=CallerAnswer.model_validate(caller),
    )


@token_router.post(
    "", response_model=NewTokenAnswer, status_code=201, responses=documented(409, 422, 507)
)
async def add(request: Request, body: TokenBody, now_ns: NowDep) -> NewTokenAnswer:
    """Create a token; from the first one on every request needs one."""
    authenticator, tokens = _tokens(request)
    try:
        secret = await QUESTIONS.run(tokens.add, body.name, body.role, now_ns)
    except TokenError as error:
        raise HTTPException(409, str(error)) from None
    await QUESTIONS.run(authenticator.refresh, now_ns)
    return NewTokenAnswer(name=body.name, role=body.role, token=secret)


@token_router.delete("/{name}", status_code=204, responses=documented(404, 507))
async def revoke(request: Request, name: str, now_ns: NowDep) -> None:
    """Revoke a token at once."""
    authenticator, tokens = _tokens(request)
    try:
        await QUESTIONS.run(tokens.revoke, name)
    except TokenError as error:
        raise HTTPException(404, str(error)) from None
    await QUESTIONS.run(authenticator.refresh, now_ns)
