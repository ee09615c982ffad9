"""Guard before every route: the check of the Host header, and the security headers."""

from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .problems import problem_response

_SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "[::1]")

SECURITY_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
}

_STRICTLY_TLS = "max-age=31536000"
"""A browser that was here once asks by TLS for a year; not of loopback, which others share."""


class Guard:
    """Refuses foreign host names, so that no web page can reach the service by DNS rebinding.

    Requests that change something are also refused from pages of another origin.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str] = LOOPBACK_HOSTS) -> None:
        self._app = app
        self._hosts = frozenset(host.lower() for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        headers = Headers(scope=scope)
        host = headers.get("host", "")

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    answer.setdefault(name, value)
                if scope["scheme"] == "https" and name_of(host) not in LOOPBACK_HOSTS:
                    answer.setdefault("strict-transport-security", _STRICTLY_TLS)
                answer.setdefault("cache-control", "no-store")
            await send(message)

        if name_of(host) not in self._hosts:
            words = f"this service is not configured for the host name {host!r}"
            await problem_response(scope["path"], 400, words)(scope, receive, send_guarded)
        elif scope["method"] not in _SAFE_METHODS and not _same_origin(headers, host):
            words = f"a page of {headers.get('origin')!r} may not send this request"
            await problem_response(scope["path"], 403, words)(scope, receive, send_guarded)
        else:
            await self._app(scope, receive, send_guarded)


def _same_origin(headers: Headers, host: str) -> bool:
    """Tell whether a request comes from our own page, or from no page at all."""
    origin = headers.get("origin")
    site = headers.get("sec-fetch-site", "none")
    return site in ("none", "same-origin") and (origin is None or _host_of(origin) == host)


def _host_of(origin: str) -> str:
    return origin.partition("://")[2]


def name_of(host: str) -> str:
    """Name in a Host header, in small letters and without its port."""
    name, colon, port = host.rpartition(":")
    return (name if colon and port.isdigit() else host).lower()
