"""Every change through the interface stands in the audit log before it is answered."""

import json

import httpx
import pytest
from fastapi.routing import iter_route_contexts

from edge_service.http_api.jobs import RefusedError
from edge_service.http_api.security.access import ROUTES, Role
from edge_service.http_api.security.intent import SAFE_METHODS, ChangingRoute

SAFE = ("GET", "HEAD", "OPTIONS")
CHANGES = [(method, path) for path, way in ROUTES.items() for method in way if method not in SAFE]
BODY = {"action": "note", "user": "typed", "note": "x"}


def entries(guarded):
    return [record.entry for record in guarded.state.events.records(1, 1000)]


def filled(path: str) -> str:
    return path.replace("{axis}", "X").replace("{number}", "1").replace("{", "").replace("}", "")


@pytest.mark.parametrize(("method", "path"), CHANGES)
async def test_who_was_refused_is_noted(method, path, guarded, connect):
    """Every route that changes something, also those that will be added to the table."""
    if ROUTES[path][method] is Role.NOBODY:
        return
    client = connect(address="192.0.2.9")
    answer = await client.request(method, filled(path))
    assert answer.status_code == 401
    (noted,) = entries(guarded)
    assert (noted.who, noted.origin) == ("", "192.0.2.9")
    assert noted.action == f"{method} {filled(path)}"
    assert noted.outcome == "401 Unauthorized"


@pytest.mark.parametrize(("method", "path"), CHANGES)
async def test_whatever_is_not_refused_as_malformed_is_noted(method, path, guarded, connect):
    client = connect(address="192.0.2.9")
    answer = await client.request(method, filled(path), headers=guarded.bearer("admin"))
    seen = entries(guarded)
    if answer.status_code in (404, 405, 415, 422):
        assert seen == []
    else:
        assert [each.outcome.split()[0] for each in seen] == [str(answer.status_code)]
        assert seen[0].who == "admin 1"


async def test_sign_ins_are_noted_by_name_and_never_with_the_secret(guarded, connect):
    client = connect()
    secret = guarded.secrets["operator"]
    await client.post("/api/v1/session", json={"token": secret})
    await client.post("/api/v1/session", json={"token": "edge-wrong"})
    assert [(each.who, each.outcome) for each in entries(guarded)] == [
        ("operator 1", "200 OK"),
        ("operator 1", "401 Unauthorized"),
    ]
    text = json.dumps([each.model_dump(mode="json") for each in entries(guarded)])
    assert secret not in text
    assert "edge-wrong" not in text


async def test_a_flood_of_refusals_is_counted_instead(guarded, connect):
    client = connect()
    for _ in range(100):
        guarded.wait(1e-6)
        await client.delete("/api/v1/jobs/1")
    assert len(entries(guarded)) == 60
    guarded.wait(60.0)
    await client.delete("/api/v1/jobs/1")
    assert entries(guarded)[-1].data == {"more_refused": 40}


async def test_what_only_looks_is_not_noted(guarded, connect):
    client = connect()
    for path in ("/api/v1/audit", "/api/v1/axes", "/nothing"):
        await client.get(path, headers=guarded.bearer("operator"))
    assert entries(guarded) == []


async def test_a_command_that_the_monitor_has_noted_is_not_noted_twice(guarded, connect):
    client = connect()
    path = "/api/v1/axes/X/commands"
    answer = await client.post(path, json=BODY, headers=guarded.bearer("operator"))
    assert answer.status_code == 202
    assert entries(guarded) == []


async def test_the_log_is_shown_in_pages(guarded, connect):
    client = connect()
    for _ in range(5):
        guarded.wait(1e-6)
        await client.delete("/api/v1/jobs/1")
    whole = (await client.get("/api/v1/audit", headers=guarded.bearer("operator"))).json()
    assert whole["newest"] == 5
    assert [each["number"] for each in whole["entries"]] == [1, 2, 3, 4, 5]
    assert not any(each["problem"] for each in whole["entries"])
    query = {"before": "4", "limit": "2"}
    part = await client.get("/api/v1/audit", params=query, headers=guarded.bearer("operator"))
    assert [each["number"] for each in part.json()["entries"]] == [2, 3]
    assert part.json()["entries"] == whole["entries"][1:3]


NOTED_BY_OTHERS = {
    "/api/v1/session": "a session changes nothing that outlives the process",
    "/api/v1/axes/{axis}/commands": "the monitor notes commands",
}


def test_every_route_that_changes_something_notes_its_intent(guarded):
    plain = {
        context.path
        for context in iter_route_contexts(guarded.app.routes)
        if set(context.methods or ()) - set(SAFE_METHODS)
        and not isinstance(context.original_route, ChangingRoute)
    }
    assert plain == set(NOTED_BY_OTHERS)


class Desk:
    """Says what the audit log held when it was asked to do something, and fails."""

    def __init__(self, guarded, error):
        self._guarded, self._error = guarded, error
        self.seen = []

    def __getattr__(self, _name):
        def work(*_args, **_more):
            self.seen = [(each.who, each.action, each.outcome) for each in entries(self._guarded)]
            raise self._error

        return work


BODIES = {
    "/api/v1/jobs": {"kind": "diagnose", "axis": "X", "recordings": ["a.csv"]},
    "/api/v1/axes/{axis}/diagnose": {"recordings": ["a.csv"]},
    "/api/v1/axes/{axis}/recording": {"seconds": 10.0},
}


@pytest.mark.parametrize("error", [RefusedError(409, "no"), RuntimeError("a fault")])
@pytest.mark.parametrize(
    ("method", "path"), [row for row in CHANGES if row[1] not in NOTED_BY_OTHERS]
)
async def test_the_intent_stands_before_the_change_and_the_outcome_after_it(
    method, path, error, guarded
):
    desk = Desk(guarded, error)
    for name in ("desk", "outputs", "motion_desk"):
        setattr(guarded.app.state, name, desk)
    body = {"json": BODIES.get(path, {})} if method != "DELETE" else {}
    transport = httpx.ASGITransport(guarded.app, False, client=("192.0.2.9", 50000))
    async with httpx.AsyncClient(transport=transport, base_url="https://box:8443") as client:
        answer = await client.request(method, filled(path), headers=guarded.bearer("admin"), **body)
    action = f"{method} {filled(path)}"
    assert desk.seen == [("admin 1", action, "begun")]
    before, after = entries(guarded)
    assert (after.who, after.origin, after.action) == ("admin 1", "192.0.2.9", action)
    assert after.outcome.split()[0] == str(answer.status_code)
    assert after.data["request"] == before.data["request"]


async def test_what_makes_no_sense_has_no_intent(guarded, connect):
    guarded.app.state.desk = Desk(guarded, RefusedError(409, "no"))
    headers = guarded.bearer("admin")
    answer = await connect().request("POST", "/api/v1/jobs", json={"kind": "x"}, headers=headers)
    assert (answer.status_code, entries(guarded)) == (422, [])
