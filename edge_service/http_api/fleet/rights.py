"""Table of rights of a fleet node's interface."""

from ..security.access import ROUTES, Rights, Role

_SHARED = ("/", "/static/{path:path}", "/api/v1/session", "/readyz", "/metrics", "/openapi.json")
_FLEET = "/api/v1/fleet"
FLEET_RIGHTS = Rights(
    {path: ROUTES[path] for path in _SHARED}
    | {
        "/livez": {"GET": Role.NOBODY},
        _FLEET: {"GET": Role.VIEWER},
        f"{_FLEET}/{{site}}/{{machine}}": {"DELETE": Role.OPERATOR},
        f"{_FLEET}/{{site}}/{{machine}}/{{axis}}/history": {"GET": Role.VIEWER},
    }
)
