"""The table of rights, whole: every route by every role."""

import re
from itertools import product

import pytest
from fastapi.routing import iter_route_contexts
from starlette.routing import Mount

from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import STATIC, create_app
from edge_service.http_api.security.access import ROUTES, Rights, Role

ROWS = [(path, method) for path, methods in ROUTES.items() for method in methods]
OPEN_TO_ALL = {"/", "/static/{path:path}", "/healthz", "/api/v1/session"}
FILLED = {"axis": "X", "form": "arrow", "path": "app.js", "number": "1", "name": "a.csv"}
FILLED |= {"output": "webhook", "letter": "1"}


def request_path(path: str) -> str:
    """A path that a route takes."""
    return re.sub(r"\{(\w+)(:path)?\}", lambda match: FILLED[match[1]], path)


def routes_of_the_app() -> set[tuple[str, str]]:
    """Path and method of every route, whether or not the description names it."""
    app = create_app(ServiceState({}, 0), lambda: 0)
    found = set()
    for route in app.routes:
        if isinstance(route, Mount):
            found.add((f"{route.path}/{{path:path}}", "GET"))
    for context in iter_route_contexts(app.routes):
        found |= {(context.path, method) for method in context.methods or ()}
    return {row for row in found if row[1] != "HEAD"}


def test_the_table_names_exactly_the_routes_of_the_app() -> None:
    assert routes_of_the_app() == set(ROWS)


def test_only_the_page_and_the_sign_in_are_open_to_all() -> None:
    opened = {path for path, method in ROWS if ROUTES[path][method] is Role.NOBODY}
    assert opened == OPEN_TO_ALL


NOT_FOR_VIEWERS = {"/api/v1/audit"}
"""Who did what, from where: not for screens in the hall."""


def test_who_only_looks_changes_nothing() -> None:
    for path, method in ROWS:
        if path not in OPEN_TO_ALL | NOT_FOR_VIEWERS:
            assert (ROUTES[path][method] is Role.VIEWER) == (method == "GET"), (path, method)


@pytest.mark.parametrize("role", Role, ids=lambda role: role.name.lower())
async def test_each_role_takes_what_the_table_gives_it(guarded, connect, role):
    guarded.state.close()  # the live stream ends at once
    client = connect()
    for path, method in ROWS:
        headers = guarded.bearer(role.name.lower())
        answer = await client.request(method, request_path(path), headers=headers)
        if role >= ROUTES[path][method]:
            assert answer.status_code not in (401, 403), (path, method)
        else:
            assert answer.status_code == (401 if role is Role.NOBODY else 403), (path, method)
            assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("role", Role, ids=lambda role: role.name.lower())
async def test_a_session_tells_the_table(guarded, connect, role):
    answer = await connect().get("/api/v1/session", headers=guarded.bearer(role.name.lower()))
    rights = answer.json()["rights"]
    if role is Role.NOBODY:
        assert rights == {}
    else:
        named = {path: {m: Role[r.upper()] for m, r in row.items()} for path, row in rights.items()}
        assert named == ROUTES


RIGHT = re.compile(r'\["([A-Z]+)", "(/api/[^"]+)"\]')
CHANGE = re.compile(r'"(POST|PUT|DELETE)"')


def test_whatever_changes_something_on_the_page_asks_for_its_right() -> None:
    for path in sorted(STATIC.glob("*.js")):
        code = path.read_text()
        rights = RIGHT.findall(code)
        assert {(row, method) for method, row in rights} <= set(ROWS), path.name
        asked = set(CHANGE.findall(code))
        if asked and path.name != "session.js":
            assert asked <= {method for method, _ in rights}, path.name


METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "ODD")
STRANGE = ("/nothing", "/api/v1", "/api/v1/axes/X/commands/", "//api/v1/axes", "/API/V1/AXES")
STRANGE += ("/api/v1/axes;x", "/metrics%00", "/healthz/x", "/healthz%0A")


async def test_what_the_table_does_not_name_is_refused(guarded, connect):
    client = connect()
    for path, method in product(STRANGE, METHODS):
        stranger = await client.request(method, path)
        admin = await client.request(method, path, headers=guarded.bearer("admin"))
        assert stranger.status_code == 401, (path, method)
        assert admin.status_code in (404, 405, 307), (path, method)
    assert guarded.sent == []


async def test_no_method_beside_the_table_gets_through(guarded, connect):
    """What takes GET takes HEAD."""
    client = connect()
    for path, methods in ROUTES.items():
        for method in set(METHODS) - set(methods) - ({"HEAD"} if "GET" in methods else set()):
            headers = guarded.bearer("admin")
            answer = await client.request(method, request_path(path), headers=headers)
            assert answer.status_code == 405, (path, method)
            allowed = {*methods, "HEAD"} if "GET" in methods else set(methods)
            assert set(answer.headers["allow"].split(", ")) == allowed


def test_where_two_rows_match_the_stricter_one_holds() -> None:
    rows = [("/a/{any}", {"GET": Role.VIEWER}), ("/a/b", {"GET": Role.ADMIN})]
    for order in (rows, rows[::-1]):
        assert Rights(dict(order)).methods_of("/a/b") == {"GET": Role.ADMIN}


async def test_a_route_that_the_table_does_not_name_is_refused_even_without_tokens(client, scene):
    scene.app.add_api_route("/api/v1/forgotten", lambda: "here")
    assert (await client.get("/api/v1/forgotten")).status_code == 404
    assert (await client.get("/api/v1/axes")).status_code == 200
