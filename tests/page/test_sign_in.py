"""Signing in on the page, by TLS and on loopback, in a real browser."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from edge_service.certificates import make_certificates
from edge_service.config import HttpConfig
from edge_service.config_tables import WebhookConfig
from edge_service.http_api.security.tokens import add_token, revoke_token

from .conftest import serious_faults, show_tab

HEALTHY = {"scenario": "healthy"}
REFUSED = "the server responded with a status of 401"


def guarded(folder: Path, scheme: str) -> HttpConfig:
    """A service that asks for tokens, with a certificate of its own or plainly on loopback."""
    tokens = folder / "tokens.json"
    if scheme == "http":
        return HttpConfig(tokens_file=tokens)
    make_certificates(folder, (), {}, 1)
    pair = {"certificate": folder / "server.pem", "private_key": folder / "server.key"}
    return HttpConfig(tokens_file=tokens, **pair)


def lose_the_answer(route: Any) -> None:
    """Let a request through, and its answer be lost on the way back."""
    assert route.fetch().status == 202
    route.abort()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["https", "http"])
def test_a_person_signs_in_and_is_known_by_the_token(
    scheme: str, make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    tokens = tmp_path / "tokens.json"
    kim, screen = (
        add_token(tokens, name, role, 1, datetime.now(UTC))
        for name, role in (("Kim", "operator"), ("screen", "viewer"))
    )
    service = make_service(guarded(tmp_path, scheme), **HEALTHY)
    assert service.address.startswith(f"{scheme}://")
    seen = open_page(service.address, bypass_csp=True, ignore_https_errors=True)
    page = seen.page
    page.wait_for_selector("#token:visible")
    assert serious_faults(page) == []
    page.fill("#token", "edge-wrong")
    page.press("#token", "Enter")
    page.wait_for_selector("text=You are not signed in: this token is unknown or has expired")
    page.fill("#token", kim)
    page.press("#token", "Enter")
    page.wait_for_selector("#answer[data-level=ok]")
    page.wait_for_selector("text=Kim (operator)")
    assert serious_faults(page) == []
    show_tab(page, "history")
    page.click("text=Write a note")
    assert page.input_value("#ask-user") == "Kim"
    page.fill("#ask-note", "looked at")
    page.route("**/commands", lose_the_answer, times=1)
    page.click("#ask-ok")
    page.wait_for_selector("#ask-error:has-text('It was not accepted')")
    page.click("#ask-ok")
    page.wait_for_selector("#ask", state="hidden")
    page.wait_for_selector('#diary :text("looked at (Kim)")')
    assert page.locator('#diary :text("looked at (Kim)")').count() == 1
    show_tab(page, "service")
    page.click("text=Audit log: who changed what")
    page.wait_for_selector("text=note X: done (from 127.0.0.1)")
    assert page.get_by_text("without an outcome").count() == 0
    revoke_token(tokens, "Kim")
    page.wait_for_selector("#token:visible")
    page.fill("#token", screen)
    page.press("#token", "Enter")
    show_tab(page, "history")
    page.wait_for_selector("text=To write notes: this needs the role operator, yours is viewer.")
    assert page.query_selector("text=Write a note") is None
    page.click("#sign-out")
    page.wait_for_selector("#token:visible")
    assert page.context.cookies() == []
    seen.faults[:] = [
        each for each in seen.faults if not re.search("40|ERR_FAILED", each)
    ]  # refusals, as expected


SUDDEN = {"scenario": "sudden", "life_h": 4.0, "acceleration": 180.0, "hold_s": 2.0}
LOOKING = r"Sign out|Show|\d+ (min|h|days)|1 year|All|Zoom|Reset"
OPERATORS = {"Acknowledge", "Shelve 8 h", "Write a note", "Part replaced"}
OPERATORS |= {"Record", "Start", "Compare", "Cancel job 1", "Try all of webhook again", "Try again"}
ADMINS = {"Remove trace.csv", "Drop"}
REASON = "this needs the role {}, yours is {}."


def changing(page: Any) -> set[str]:
    """Names of the buttons that change something."""
    nodes = page.query_selector_all("button:visible")
    names = [node.get_attribute("aria-label") or node.inner_text() for node in nodes]
    return {name.partition(": ")[0] for name in names if not re.fullmatch(LOOKING, name)}


def fill(page: Any) -> None:
    """Let there be something that every button of the page is for."""
    then = "2026-01-01T00:00:00Z"
    letter = {"id": "1", "time": then, "axis": "X", "message": "fell", "reason": "400", "tries": 1}
    job = {"id": 1, "kind": "fingerprint", "axis": "X", "state": "running", "started": then}
    answers = {
        "recordings": {"recordings": [{"name": "trace.csv", "size": 1000, "modified": then}]},
        "jobs": {"jobs": [job | {"files": [], "ended": None, "lines": []}]},
        "outputs": {"outputs": [{"output": "webhook", "dead_letters": [letter]}]},
    }

    def answer(route: Any) -> None:
        route.fulfill(json=answers[route.request.url.rpartition("/")[2]])

    for path in answers:
        page.route(f"**/api/v1/{path}", answer)


@pytest.mark.slow
def test_nobody_sees_a_button_that_would_be_refused(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    secrets = {
        role: add_token(tmp_path / "tokens.json", role, role, 1, datetime.now(UTC))
        for role in ("viewer", "operator", "admin")
    }
    receiver, secret = SecretStr("http://127.0.0.1:9/"), SecretStr("a secret of some length")
    webhook = WebhookConfig(url=receiver, secret=secret, buffer=tmp_path / "spool")
    service = make_service(guarded(tmp_path, "http"), webhook, **SUDDEN)
    for role, token in secrets.items():
        page = open_page(service.address, bypass_csp=True).page
        fill(page)
        page.fill("#token", token)
        page.press("#token", "Enter")
        page.wait_for_selector("#alarms >> text=Sudden drop")
        found = changing(page)
        for tab, awaited in (
            ("history", "#drift-title"),
            ("tests", "text=trace.csv"),
            ("service", "text=Not delivered"),
        ):
            show_tab(page, tab)
            page.wait_for_selector(awaited)
            found |= changing(page)
        assert found == {"viewer": set(), "operator": OPERATORS, "admin": OPERATORS | ADMINS}[role]
        assert page.locator("input[type=file]").count() == (role != "viewer")
        reasons = " ".join(page.locator(".not-allowed").all_inner_texts())
        assert (REASON.format("operator", role) in reasons) == (role == "viewer")
        assert (REASON.format("admin", role) in reasons) == (role != "admin")
        assert page.get_by_text("Audit log: who changed what").count() == (role != "viewer")
        assert serious_faults(page) == []
        page.context.close()
