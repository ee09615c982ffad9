"""The table of rights: which role may take which route. What is not in it is refused."""

import re
from enum import IntEnum


class Role(IntEnum):
    """Roles by rank: each may do what those before it may."""

    NOBODY = 0
    VIEWER = 1  # looks
    OPERATOR = (
        2  # answers alarms, writes notes, uploads, runs jobs, sends again; reads the audit log
    )
    ADMIN = 3  # removes what others have made


_NOBODY, _VIEWER, _OPERATOR, _ADMIN = Role
_AXIS = "/api/v1/axes/{axis}"
ROUTES: dict[str, dict[str, Role]] = {
    "/": {"GET": _NOBODY},  # the page without a number, and the form to sign in
    "/static/{path:path}": {"GET": _NOBODY},
    "/healthz": {"GET": _NOBODY},
    "/api/v1/session": {"GET": _NOBODY, "POST": _NOBODY, "DELETE": _NOBODY},
    "/readyz": {"GET": _VIEWER},
    "/metrics": {"GET": _VIEWER},
    "/openapi.json": {"GET": _VIEWER},
    "/docs": {"GET": _VIEWER},
    "/api/v1/schemas": {"GET": _VIEWER},
    "/api/v1/health": {"GET": _VIEWER},
    "/api/v1/audit": {"GET": _OPERATOR},
    "/api/v1/events": {"GET": _VIEWER},
    "/api/v1/axes": {"GET": _VIEWER},
    f"{_AXIS}/preload": {"GET": _VIEWER},
    f"{_AXIS}/health": {"GET": _VIEWER},
    f"{_AXIS}/history": {"GET": _VIEWER},
    f"{_AXIS}/history.{{form}}": {"GET": _VIEWER},
    f"{_AXIS}/traces": {"GET": _VIEWER},
    f"{_AXIS}/use": {"GET": _VIEWER},
    f"{_AXIS}/stroke": {"GET": _VIEWER},
    f"{_AXIS}/friction": {"GET": _VIEWER},
    f"{_AXIS}/log": {"GET": _VIEWER},
    f"{_AXIS}/diagnosis": {"GET": _VIEWER},
    f"{_AXIS}/diagnose": {"POST": _OPERATOR},
    f"{_AXIS}/motions": {"GET": _VIEWER},
    f"{_AXIS}/motions/{{name}}.{{form}}": {"GET": _VIEWER},
    f"{_AXIS}/recording": {"GET": _VIEWER, "POST": _OPERATOR, "DELETE": _OPERATOR},
    f"{_AXIS}/commands": {"POST": _OPERATOR},
    "/api/v1/outputs": {"GET": _VIEWER},
    "/api/v1/outputs/{output}/dead": {"POST": _OPERATOR},
    "/api/v1/outputs/{output}/dead/{letter}": {"POST": _OPERATOR, "DELETE": _ADMIN},
    "/api/v1/recordings": {"GET": _VIEWER},
    "/api/v1/recordings/{name}": {"GET": _VIEWER, "PUT": _OPERATOR, "DELETE": _ADMIN},
    "/api/v1/jobs": {"GET": _VIEWER, "POST": _OPERATOR},
    "/api/v1/jobs/{number}": {"GET": _VIEWER, "DELETE": _OPERATOR},
    "/api/v1/jobs/{number}/files/{name}": {"GET": _VIEWER},
}
"""Path, as its route writes it -> method -> the least role that may take it."""


def _pattern(path: str) -> re.Pattern[str]:
    parts = re.split(r"(\{\w+(?::path)?\})", path)
    words = (
        ".*" if p.endswith(":path}") else "[^/]+" if p[:1] == "{" else re.escape(p) for p in parts
    )
    return re.compile("".join(words), re.DOTALL)


Routes = dict[str, dict[str, Role]]
"""Path, as its route writes it -> method -> the least role that may take it."""


class Rights:
    """Table of rights of an application."""

    def __init__(self, routes: Routes) -> None:
        self.routes = routes
        self._patterns = [(_pattern(path), methods) for path, methods in routes.items()]

    def methods_of(self, path: str) -> dict[str, Role]:
        """Methods of a request's path with the role that each needs; empty without such a path.

        Where two rows match, the stricter one holds.
        """
        needed: dict[str, Role] = {}
        for pattern, methods in self._patterns:
            if pattern.fullmatch(path):
                for method, role in methods.items():
                    needed[method] = max(role, needed.get(method, Role.NOBODY))
        return needed


RIGHTS = Rights(ROUTES)
methods_of = RIGHTS.methods_of
