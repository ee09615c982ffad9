"""Admission to the API: every route by every role, hosts, origins, and tokens that come and go."""

import asyncio
import base64
import re
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest
from fastapi.routing import iter_route_contexts

from edge_service.health.service_state import ServiceState
from edge_service.health.store.store import Store
from edge_service.health.store.tokens import Tokens
from edge_service.http_api.app import create_app, static_digest
from edge_service.http_api.guard import Authenticator, Caller
from edge_service.messages.health import Command, Outcome

from ..nodes.conftest import until
from .conftest import client_of

START_NS = 1_769_860_800_000_000_000
AXES, TOKENS = "/api/v1/axes", "/api/v1/tokens"
NOTE = {"action": "note", "user": "Mallory", "note": "seen"}
FILLED = {"axis": "X", "path": "app.js", "id": "1", "name": "a.csv"}
FILLED |= {"output": "mqtt"}


@dataclass
class Guarded:
    folder: Path
    now_ns: int = START_NS
    sent: list[Command] = field(default_factory=list)
    noted: list[tuple[Caller, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.tokens = Tokens(Store(self.folder / "edge-service.sqlite"))
        self.secrets = {
            "Kim": self.tokens.add("Kim", "operator", self.now_ns),
            "screen": self.tokens.add("screen", "viewer", self.now_ns),
        }
        self.authenticator = Authenticator(self.tokens)
        self.state = ServiceState({"X": None}, self.now_ns)
        self.app = create_app(
            self.state,
            lambda: self.now_ns,
            ["box", "127.0.0.1"],
            send_command=self._send,
            authenticator=self.authenticator,
            note_change=lambda caller, action: self.noted.append((caller, action)),
        )

    async def _send(self, _axis: str, command: Command) -> Outcome:
        self.sent.append(command)
        return Outcome(accepted=True)

    def bearer(self, name: str) -> dict[str, str]:
        return {"authorization": f"Bearer {self.secrets[name]}"}

    def basic(self, name: str) -> dict[str, str]:
        """Headers of a browser, whose user typed the token as the password."""
        sent = base64.b64encode(f"whoever:{self.secrets[name]}".encode()).decode()
        return {"authorization": f"Basic {sent}"}


@pytest.fixture
def guarded(tmp_path: Path) -> Guarded:
    return Guarded(tmp_path)


@pytest.fixture
async def box(guarded: Guarded) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(guarded.app, "https://box:8443", client=("192.0.2.7", 1)) as client:
        yield client


FILLED |= {"digest": static_digest()}


def rows() -> list[tuple[str, str]]:
    """Method and path of every route, whether or not the description names it."""
    app = create_app(ServiceState({}, 0), lambda: 0)
    found = set()
    for route in iter_route_contexts(app.routes):
        for method in route.methods or ():
            if route.path != "/healthz":
                path = re.sub(r"\{(\w+)(:path)?\}", lambda match: FILLED[match[1]], route.path)
                found.add((method, path))
    return sorted(found)


@pytest.mark.parametrize(("method", "path"), rows())
async def test_every_route_but_healthz_wants_a_token_and_changes_an_operator(
    guarded: Guarded, box: httpx.AsyncClient, method: str, path: str
) -> None:
    guarded.state.readers.close()  # the live stream ends at once
    nobody = await box.request(method, path)
    assert nobody.status_code == 401
    assert nobody.headers["www-authenticate"].startswith("Basic ")
    assert nobody.headers["content-type"] == "application/problem+json"
    viewer = await box.request(method, path, headers=guarded.bearer("screen"))
    if method == "GET":
        assert viewer.status_code not in (401, 403)
    else:
        assert viewer.status_code == 403
    operator = await box.request(method, path, headers=guarded.basic("Kim"))
    assert operator.status_code not in (401, 403)


async def test_healthz_and_loopback_without_tokens_want_none(
    box: httpx.AsyncClient, client: httpx.AsyncClient
) -> None:
    assert (await box.get("/healthz")).status_code == 200
    assert (await client.get(AXES)).status_code == 200
    assert (await client.get(TOKENS)).json()["caller"] == {
        "name": None,
        "role": "operator",
        "origin": "127.0.0.1",
    }


@pytest.mark.parametrize(
    "sent", ["Bearer ", "Bearer x", "Basic YTpi", "Basic \xff", "Basic a", "bearer", "Digest a"]
)
async def test_what_is_no_token_is_nobody(box: httpx.AsyncClient, sent: str) -> None:
    headers = {"authorization": sent.encode("latin-1")}
    assert (await box.get(AXES, headers=headers)).status_code == 401


async def test_the_first_token_closes_the_door_and_the_last_one_opens_it(tmp_path: Path) -> None:
    authenticator = Authenticator(Tokens(Store(tmp_path / "edge-service.sqlite")))
    app = create_app(ServiceState({}, 0), lambda: START_NS, authenticator=authenticator)
    async with client_of(app) as client:
        made = await client.post(TOKENS, json={"name": "Kim", "role": "operator"})
        assert made.status_code == 201
        assert (await client.get(AXES)).status_code == 401
        client.headers["authorization"] = f"Bearer {made.json()['token']}"
        again = await client.post(TOKENS, json={"name": "Kim", "role": "viewer"})
        assert again.status_code == 409
        wrong = await client.post(TOKENS, json={"name": "a/b", "role": "viewer"})
        assert wrong.status_code == 422
        listed = (await client.get(TOKENS)).json()
        assert (listed["caller"]["name"], listed["caller"]["role"]) == ("Kim", "operator")
        assert listed["items"][0]["created_at"] == "2026-01-31T12:00:00.000Z"
        assert (await client.delete(f"{TOKENS}/Jo")).status_code == 404
        assert (await client.delete(f"{TOKENS}/Kim")).status_code == 204
        del client.headers["authorization"]
        assert (await client.get(AXES)).status_code == 200


def test_a_damaged_store_opens_no_door(tmp_path: Path) -> None:
    path = tmp_path / "edge-service.sqlite"
    first = Tokens(Store(path))
    first.add("Kim", "operator", 0)
    path.write_bytes(b"damaged" * 1000)
    tokens = Tokens(Store(path))
    assert tokens.all() == ()
    assert Authenticator(tokens).needs_token


async def test_a_token_that_another_process_adds_or_revokes_counts_with_the_next_look(
    guarded: Guarded, box: httpx.AsyncClient
) -> None:
    beside = Tokens(Store(guarded.folder / "edge-service.sqlite"))
    guarded.secrets["Jo"] = beside.add("Jo", "viewer", 0)
    beside.revoke("Kim")
    guarded.authenticator.refresh(guarded.now_ns)
    assert (await box.get(AXES, headers=guarded.bearer("Jo"))).status_code == 200
    assert (await box.get(AXES, headers=guarded.bearer("Kim"))).status_code == 401
    guarded.authenticator.refresh(guarded.now_ns)
    used = {token.name: token.used_ns for token in beside.all()}
    assert used == {"Jo": guarded.now_ns, "screen": None}


async def test_the_token_names_who_commands_whatever_is_typed(
    guarded: Guarded, box: httpx.AsyncClient
) -> None:
    asked = await box.post(f"{AXES}/X/commands", json=NOTE, headers=guarded.bearer("Kim"))
    assert asked.status_code == 202
    assert [(each.user, each.origin) for each in guarded.sent] == [("Kim", "192.0.2.7")]


async def test_a_change_is_noted_with_who_made_it_and_from_where(
    guarded: Guarded, box: httpx.AsyncClient
) -> None:
    headers = guarded.bearer("Kim")
    await box.post(TOKENS, json={"name": "Jo", "role": "viewer"}, headers=headers)
    await box.get(TOKENS, headers=headers)
    await box.delete(f"{TOKENS}/nobody", headers=headers)
    await box.delete(f"{TOKENS}/Jo", headers=guarded.bearer("screen"))
    assert guarded.noted == [
        (Caller(name="Kim", role="operator", origin="192.0.2.7"), f"POST {TOKENS}"),
        (Caller(name="screen", role="viewer", origin="192.0.2.7"), f"refused DELETE {TOKENS}/Jo"),
    ]


FOREIGN = [{"origin": "https://evil.example"}, {"origin": "null"}, {"origin": "https://box:9999"}]
FOREIGN += [{"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"}]


@pytest.mark.parametrize("headers", FOREIGN)
async def test_no_other_site_acts_for_a_browser(
    guarded: Guarded, box: httpx.AsyncClient, headers: dict[str, str]
) -> None:
    sent = headers | guarded.basic("Kim")
    answer = await box.post(f"{AXES}/X/commands", json=NOTE, headers=sent)
    assert (answer.status_code, guarded.sent) == (403, [])
    own = {"origin": "https://box:8443", "sec-fetch-site": "same-origin"} | guarded.basic("Kim")
    assert (await box.post(f"{AXES}/X/commands", json=NOTE, headers=own)).is_success


async def test_a_live_stream_ends_with_its_token(guarded: Guarded, box: httpx.AsyncClient) -> None:
    reading = asyncio.create_task(box.get("/api/v1/events", headers=guarded.bearer("screen")))
    await until(lambda: len(guarded.state.readers) == 1)
    guarded.tokens.revoke("screen")
    guarded.authenticator.refresh(guarded.now_ns)
    async with asyncio.timeout(60.0):
        while not reading.done():
            guarded.now_ns += 1_000_000_000
            await asyncio.sleep(0.01)
    assert (reading.result().status_code, len(guarded.state.readers)) == (200, 0)


async def test_no_secret_is_described_or_listed(guarded: Guarded, box: httpx.AsyncClient) -> None:
    for path in ("/openapi.json", TOKENS):
        text = (await box.get(path, headers=guarded.bearer("screen"))).text
        assert not any(secret in text for secret in guarded.secrets.values())
