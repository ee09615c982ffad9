"""Interface of a fleet node: who may ask what, and what is answered."""

from collections.abc import AsyncIterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest

from edge_service.health.fleet.plant_rows import FleetNodeState, PlantTable
from edge_service.health.fleet.rows import FleetRow, compared
from edge_service.http_api.fleet.app import create_fleet_app
from edge_service.http_api.fleet.desk import AxisPast
from edge_service.http_api.fleet.rights import FLEET_RIGHTS
from edge_service.http_api.security.doorkeeper import Doorkeeper
from edge_service.http_api.security.tokens import TokenFile, add_token
from edge_service.messages.fleet import HistoryPoint, HistoryQuestion, Hole
from edge_service.messages.health import AxisCondition

S = 1_000_000_000


def rows() -> tuple[FleetRow, ...]:
    conditions = {7: AxisCondition.FAULT, 8: AxisCondition.UNAVAILABLE}
    return tuple(
        compared(
            [
                FleetRow(
                    "http://edge",
                    f"hall{k % 2}",
                    f"m{k}",
                    "X",
                    conditions.get(k, AxisCondition.NORMAL),
                    loss_percent_per_1000_h=(90.0 if k == 9 else 10.0, 9.0, 11.0),
                )
                for k in range(20)
            ]
        )
    )


class Desk:
    """A fleet node that says what it is told to."""

    name = "one"

    def __init__(self) -> None:
        self.reasons: list[str] = []
        self.removed: list[tuple[str, str]] = []
        self.asked: list[HistoryQuestion] = []

    async def table(self) -> PlantTable:
        nodes = (FleetNodeState("one", answered=True, parts=64), FleetNodeState("two", False))
        return PlantTable(rows(), nodes, ("the fleet node two does not answer",), 20)

    async def past(self, question: HistoryQuestion) -> AxisPast:
        self.asked.append(question)
        if question.machine != "m1":
            return AxisPast(())
        condition = AxisCondition.NORMAL
        point = HistoryPoint(log="l", number=3, time_ns=S, condition=condition)
        known = point.model_copy(
            update={"number": 4, "preload_percent": 8.0, "fresh_percent": 10.0}
        )
        return AxisPast((point, known), (Hole(log="l", first=1, last=2),))

    async def remove(self, site: str, machine: str) -> bool:
        self.removed.append((site, machine))
        return machine == "m1"

    def unready(self) -> list[str]:
        return self.reasons

    def counters(self) -> Mapping[str, int]:
        return {"received": 5}

    def readings(self) -> Mapping[str, float]:
        return {"parts": 64.0}

    def refused(self) -> Mapping[tuple[str, str], int]:
        return {("feeddrive/plant/v1/1/s/m", "misplaced"): 2}


@pytest.fixture
def desk() -> Desk:
    return Desk()


@pytest.fixture
async def client(desk: Desk) -> AsyncIterator[httpx.AsyncClient]:
    transport = httpx.ASGITransport(create_fleet_app(desk))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        yield client


async def test_rows_come_worst_first_and_in_pages(client: httpx.AsyncClient) -> None:
    whole = (await client.get("/api/v1/fleet")).json()
    assert [row["machine"] for row in whole["rows"][:3]] == ["m7", "m8", "m9"]
    assert whole["condition"] == "FAULT"
    assert whole["counts"] == {"FAULT": 1, "WARNING": 0, "UNAVAILABLE": 1, "NORMAL": 18}
    assert whole["faster"] == 1
    assert whole["missing"] == ["the fleet node two does not answer"]
    assert [node["answered"] for node in whole["nodes"]] == [True, False]
    page = (await client.get("/api/v1/fleet?offset=18&limit=5")).json()
    assert page["rows"] == whole["rows"][18:]
    assert page["matching"] == 20


@pytest.mark.parametrize(
    ("asked", "matching"),
    [
        ("site=hall1", 10),
        ("machine=m3", 1),
        ("condition=NORMAL", 18),
        ("search=HALL0%2Fm1", 5),
        ("faster=true", 1),
        ("search=m1&site=hall0&condition=FAULT", 0),
    ],
)
async def test_filters_narrow_the_rows_and_not_the_counts(
    client: httpx.AsyncClient, asked: str, matching: int
) -> None:
    answer = (await client.get(f"/api/v1/fleet?{asked}")).json()
    assert answer["matching"] == len(answer["rows"]) == matching
    assert answer["axes"] == 20


@pytest.mark.parametrize("wrong", ["limit=0", "limit=501", "offset=-1", "condition=BAD"])
async def test_a_question_that_makes_no_sense_is_refused(
    client: httpx.AsyncClient, wrong: str
) -> None:
    answer = await client.get(f"/api/v1/fleet?{wrong}")
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


async def test_the_past_of_an_axis_says_what_is_gone(client: httpx.AsyncClient, desk: Desk) -> None:
    past = (await client.get("/api/v1/fleet/hall1/m1/X/history?from=1970-01-01T00:00:01Z")).json()
    assert desk.asked[-1].since_ns == S
    assert [point["share_percent"] for point in past["points"]] == [None, 80.0]
    assert past["points"][0]["time"] == "1970-01-01T00:00:01.000Z"
    assert past["holes"] == [{"log": "l", "first": 1, "last": 2}]
    assert (await client.get("/api/v1/fleet/hall1/m3/X/history")).json()["points"] == []
    assert (await client.get("/api/v1/fleet/hall1/m99/X/history")).status_code == 404


async def test_a_machine_that_is_gone_can_be_removed(client: httpx.AsyncClient, desk: Desk) -> None:
    assert (await client.delete("/api/v1/fleet/hall1/m1")).status_code == 204
    assert (await client.delete("/api/v1/fleet/hall1/m2")).status_code == 404
    assert desk.removed == [("hall1", "m1"), ("hall1", "m2")]


async def test_a_node_that_reads_nothing_is_alive_and_not_ready(
    client: httpx.AsyncClient, desk: Desk
) -> None:
    assert (await client.get("/readyz")).status_code == 200
    desk.reasons = ["no router of the plant answers"]
    answer = await client.get("/readyz")
    assert answer.status_code == 503
    assert answer.json()["reasons"] == desk.reasons
    assert (await client.get("/livez")).status_code == 200


async def test_the_metrics_tell_of_the_plant_and_of_what_was_refused(
    client: httpx.AsyncClient,
) -> None:
    text = (await client.get("/metrics")).text
    assert 'edge_service_fleet_axes{condition="FAULT"} 1.0' in text
    assert 'edge_service_fleet_missing{node="one"} 1.0' in text
    assert 'reason="misplaced"} 2.0' in text


async def test_the_page_loads_nothing_from_elsewhere(client: httpx.AsyncClient) -> None:
    page = await client.get("/")
    assert page.status_code == 200
    assert "script-src 'self'" in page.headers["content-security-policy"]
    assert "<script>" not in page.text
    assert "style=" not in page.text
    foreign = await client.get("/", headers={"host": "evil.example"})
    assert foreign.status_code == 400


async def test_every_route_stands_in_the_table_of_rights(client: httpx.AsyncClient) -> None:
    described = (await client.get("/openapi.json")).json()["paths"]
    for path, methods in described.items():
        named = {method.upper() for method in methods}
        assert named <= FLEET_RIGHTS.routes[path].keys(), path


async def test_without_a_token_nobody_sees_an_axis(desk: Desk, tmp_path: Path) -> None:
    tokens = tmp_path / "tokens.json"
    secret = add_token(tokens, "viewer", "viewer", 1, datetime.now(UTC))
    app = create_fleet_app(desk, doorkeeper=Doorkeeper(TokenFile(tokens)))
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        assert (await client.get("/")).status_code == 200
        for path in ("/api/v1/fleet", "/metrics", "/api/v1/fleet/a/b/c/history"):
            assert (await client.get(path)).status_code == 401, path
        known = {"authorization": f"Bearer {secret}"}
        assert (await client.get("/api/v1/fleet", headers=known)).status_code == 200
        refused = await client.delete("/api/v1/fleet/hall1/m1", headers=known)
        assert refused.status_code == 403
        assert desk.removed == []
