"""Signing in: sessions that no other site can use, ended here; a limit of what may fail."""

import asyncio
import logging

import pytest

from edge_service.http_api.security.access import ROUTES
from edge_service.http_api.security.attempts import IN_ALL, MOST_CLIENTS, PER_CLIENT, Attempts
from edge_service.http_api.security.sessions import LIFETIME_S, MOST_SESSIONS, Sessions
from edge_service.http_api.security.tokens import revoke_token

SESSION = "/api/v1/session"
AXES = "/api/v1/axes"
RIGHTS = {
    path: {method: role.name.lower() for method, role in row.items()}
    for path, row in ROUTES.items()
}
NOTE = {"action": "note", "user": "Mallory", "note": "seen"}


async def sign_in(client, secret, **headers):
    return await client.post(SESSION, json={"token": secret}, headers=headers)


async def test_a_browser_signs_in_and_out(guarded, connect):
    client = connect()
    assert (await client.get(AXES)).status_code == 401
    answer = await sign_in(client, guarded.secrets["operator"])
    about = answer.json()
    assert (about.pop("rights"), about) == (
        RIGHTS,
        {"required": True, "name": "operator 1", "role": "operator"},
    )
    assert (await client.get(AXES)).status_code == 200
    assert (await client.get(SESSION)).json()["name"] == "operator 1"
    held = dict(client.cookies)
    assert (await client.delete(SESSION)).status_code == 204
    assert dict(client.cookies) == {}
    client.cookies.update(held)  # who has kept the secret has kept nothing
    assert (await client.get(AXES)).status_code == 401


@pytest.mark.parametrize(
    ("url", "name", "secure"),
    [
        ("https://box:8443", "__Host-edge-service-8443", True),
        ("http://127.0.0.1:8080", "edge-service-8080", False),
    ],
)
async def test_the_cookie_is_for_this_service_alone(guarded, connect, url, name, secure):
    answer = await sign_in(connect(url), guarded.secrets["viewer"])
    cookie, *attributes = answer.headers["set-cookie"].split("; ")
    assert cookie.startswith(f"{name}=")
    assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(attributes)
    assert ("Secure" in attributes) == secure
    assert f"Max-Age={LIFETIME_S:.0f}" in attributes
    assert not any(each.startswith("Domain") for each in attributes)
    assert guarded.secrets["viewer"] not in answer.headers["set-cookie"]


async def test_a_session_ends_by_time_by_expiry_and_by_revocation(guarded, connect):
    for end in (
        lambda: guarded.wait(LIFETIME_S),
        lambda: revoke_token(guarded.path, "admin 1"),
    ):
        client = connect()
        await sign_in(client, guarded.secrets["admin"])
        guarded.wait(LIFETIME_S - 1.0)
        assert (await client.get(AXES)).status_code == 200
        end()
        assert (await client.get(AXES)).status_code == 401
    late = connect()
    guarded.wait(30 * 86400.0 - 3 * LIFETIME_S)
    await sign_in(late, guarded.secrets["viewer"])
    assert (await late.get(AXES)).status_code == 200
    guarded.now_ns += 86_400_000_000_000  # by the clock of the day alone
    assert (await late.get(AXES)).status_code == 401


async def test_a_clock_that_is_set_back_prolongs_no_session(guarded, connect):
    client = connect()
    await sign_in(client, guarded.secrets["viewer"])
    guarded.wait(LIFETIME_S)
    guarded.now_ns -= round(2 * LIFETIME_S * 1e9)
    assert (await client.get(AXES)).status_code == 401


async def test_who_has_signed_in_is_named_by_the_token_whatever_is_typed(guarded, connect):
    client = connect()
    await sign_in(client, guarded.secrets["operator"])
    assert (await client.post(f"{AXES}/X/commands", json=NOTE)).status_code == 202
    headers = guarded.bearer("admin")
    assert (await connect().post(f"{AXES}/X/commands", json=NOTE, headers=headers)).is_success
    assert [command.user for command in guarded.sent] == ["operator 1", "admin 1"]


async def test_without_tokens_people_are_named_by_what_they_type(client):
    about = (await client.get(SESSION)).json()
    assert (about["required"], about["name"], about["role"]) == (False, None, "admin")
    answer = await sign_in(client, "anything")
    assert answer.json()["required"] is False
    assert "set-cookie" not in answer.headers


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"},
        {"origin": "null"},
        {"origin": "https://box:9999"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
async def test_no_other_site_signs_in_or_acts_for_a_browser(guarded, connect, headers):
    client = connect()
    assert (await sign_in(client, guarded.secrets["admin"], **headers)).status_code == 403
    await sign_in(client, guarded.secrets["admin"])
    for method, path in (("POST", f"{AXES}/X/commands"), ("DELETE", SESSION)):
        answer = await client.request(method, path, json=NOTE, headers=headers)
        assert answer.status_code == 403
    assert guarded.sent == []
    assert (await client.get(AXES)).status_code == 200


@pytest.mark.parametrize(
    "authorization",
    [
        "Bearer ",
        "Bearer x",
        "Basic YTpi",
        "bearer",
        "Bearer \xff",
        "Digest",
        "Bearer " + "a" * 9000,
    ],
)
async def test_what_is_no_token_is_nobody(guarded, connect, authorization):
    headers = {"authorization": authorization.encode("latin-1")}
    answer = await connect().get(AXES, headers=headers)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"


async def test_a_wrong_token_is_not_saved_by_a_session(guarded, connect):
    client = connect()
    await sign_in(client, guarded.secrets["admin"])
    assert (await client.get(AXES, headers={"authorization": "Bearer no"})).status_code == 401


async def test_sign_ins_that_fail_are_limited_by_client(guarded, connect):
    client, other = connect(), connect(address="192.0.2.8")
    for _ in range(PER_CLIENT):
        assert (await sign_in(client, "no")).status_code == 401
    answer = await sign_in(client, guarded.secrets["admin"])
    assert answer.status_code == 429
    assert 0 < int(answer.headers["retry-after"]) <= 61
    assert (await sign_in(other, guarded.secrets["admin"])).status_code == 200
    headers = guarded.bearer("admin")
    assert (await client.get(AXES, headers=headers)).status_code == 200, "programs go on"
    guarded.wait(61.0)
    assert (await sign_in(client, guarded.secrets["admin"])).status_code == 200


def test_sign_ins_that_fail_are_limited_in_all_and_by_site():
    attempts = Attempts()
    for number in range(PER_CLIENT):
        attempts.failed(f"2001:db8::{number}", 0.0)
    assert attempts.wait_s("2001:db8::ffff", 1.0) == 59.0
    assert attempts.wait_s("2001:db8:0:1::1", 1.0) == 0.0
    for number in range(IN_ALL):
        attempts.failed(f"192.0.2.{number}", 2.0)
    assert attempts.wait_s("198.51.100.1", 3.0) == 59.0
    assert attempts.wait_s("198.51.100.1", 63.0) == 0.0


def test_what_is_remembered_is_bounded():
    attempts, sessions = Attempts(), Sessions()
    for number in range(3 * MOST_CLIENTS):
        attempts.failed(f"10.0.{number // 250}.{number % 250}", float(number))
    assert len(attempts._clients) == MOST_CLIENTS
    secrets = [sessions.begin("token", 0.0) for _ in range(MOST_SESSIONS + 1)]
    assert [sessions.find(secret, 1.0) is None for secret in secrets[:2]] == [True, False]


async def test_no_secret_is_ever_logged_or_described(guarded, connect, caplog):
    caplog.set_level(logging.DEBUG)
    client = connect()
    await sign_in(client, guarded.secrets["admin"])
    await sign_in(client, "edge-a-typo")
    held = list(client.cookies.values())
    await client.get(AXES, headers=guarded.bearer("viewer"))
    schema = (await client.get("/openapi.json")).text
    for secret in (*guarded.secrets.values(), "edge-a-typo", *held):
        assert secret not in caplog.text
        assert secret not in schema
    assert "sign-in of admin 1 (admin) from 192.0.2.7" in caplog.text
    assert "sign-in from 192.0.2.7 failed" in caplog.text


async def test_a_lost_file_of_tokens_lets_nobody_in_and_is_told_once(guarded, connect, caplog):
    client = connect()
    await sign_in(client, guarded.secrets["admin"])
    guarded.path.unlink()
    for _ in range(3):
        assert (await client.get(AXES)).status_code == 401
    assert caplog.text.count("all sign-ins are refused") == 1
    assert (await client.get("/healthz")).status_code == 200


async def test_a_live_stream_ends_with_the_token(guarded, connect):
    headers = guarded.bearer("viewer")
    reading = asyncio.create_task(connect().get("/api/v1/events", headers=headers))
    async with asyncio.timeout(10.0):
        while len(guarded.state.readers) == 0:
            await asyncio.sleep(0)
        revoke_token(guarded.path, "viewer 1")
        guarded.wait(2.0)
        while not reading.done():
            guarded.wait(1.0)
            await asyncio.sleep(0.01)
    assert reading.result().status_code == 200
    assert len(guarded.state.readers) == 0


@pytest.mark.parametrize(
    ("url", "strict"),
    [("https://box:8443", True), ("https://127.0.0.1:8443", False), ("http://box", False)],
)
async def test_browsers_are_told_to_insist_on_tls(connect, url, strict):
    answer = await connect(url).get("/healthz")
    assert ("strict-transport-security" in answer.headers) == strict
    assert answer.headers["content-security-policy"].startswith("default-src 'none'")
