"""Gate before every route: nobody takes one that the table of rights does not give their role."""

from collections.abc import Collection

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from ..problems import ProblemResponse, problem_response
from .access import RIGHTS, Rights, Role
from .doorkeeper import Doorkeeper, Identity

_IDENTITY = "edge_service.identity"


class Gate:
    """Refuses what the table does not allow, before anything of the body is read."""

    def __init__(self, app: ASGIApp, doorkeeper: Doorkeeper, rights: Rights = RIGHTS) -> None:
        self._app = app
        self._doorkeeper = doorkeeper
        self._rights = rights

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on one request with the identity of who asks, or refuse it."""
        if scope["type"] == "http":
            identity = self._doorkeeper.identify(*credentials(HTTPConnection(scope)))
            refusal = _refusal(self._rights, scope["path"], scope["method"], identity)
            if refusal is not None:
                await refusal(scope, receive, send)
                return
            scope[_IDENTITY] = identity
        await self._app(scope, receive, send)


def _refusal(rights: Rights, path: str, method: str, identity: Identity) -> ProblemResponse | None:
    """Refusal of a request; None if it may pass."""
    methods = rights.methods_of(path.rstrip("/") or "/")
    needed = methods.get("GET" if method == "HEAD" else method)
    if needed is not None and identity.role >= needed:
        return None
    if identity.role is Role.NOBODY:
        words = "sign in on the page, or send a token: Authorization: Bearer TOKEN"
        return problem_response(path, 401, words, headers={"www-authenticate": "Bearer"})
    if needed is not None:
        words = f"this needs the role {needed.name.lower()}, yours is {identity.role.name.lower()}"
        return problem_response(path, 403, words)
    if methods:
        words = "this path does not support this method"
        return problem_response(path, 405, words, headers={"allow": _allowed(methods)})
    words = "there is nothing at this path; /openapi.json lists what there is"
    return problem_response(path, 404, words)


def _allowed(methods: Collection[str]) -> str:
    """Methods of a path; whatever takes GET takes HEAD."""
    return ", ".join(sorted({*methods, *(("HEAD",) if "GET" in methods else ())}))


def identity_of(request: HTTPConnection) -> Identity:
    """Identity that the gate has found."""
    identity: Identity = request.scope[_IDENTITY]
    return identity


def name_in(scope: Scope) -> str | None:
    """Proved name of who asks; None where there is none, or the gate has refused."""
    identity: Identity | None = scope.get(_IDENTITY)
    return None if identity is None else identity.name


def credentials(request: HTTPConnection) -> tuple[str, str]:
    """Credentials of a request: its authorization, and its session's secret."""
    cookie = request.cookies.get(cookie_name(request.scope), "")
    return request.headers.get("authorization", ""), cookie


def cookie_name(scope: Scope) -> str:
    """Name of the session's cookie: of this port alone, and with TLS of this host alone."""
    _, port = scope.get("server") or ("", 0)
    return f"{'__Host-' if scope['scheme'] == 'https' else ''}edge-service-{port}"
