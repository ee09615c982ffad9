"""Signing in on the page, by TLS and on loopback, in a real browser."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from edge_service.certificates import make_certificates
from edge_service.config import HttpConfig
from edge_service.http_api.security.tokens import add_token, revoke_token

from .conftest import serious_faults

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
    page.wait_for_selector("text=You are not signed in: this is no token, or it has ended")
    page.fill("#token", kim)
    page.press("#token", "Enter")
    page.wait_for_selector("#answer[data-condition=NORMAL]")
    page.wait_for_selector("text=Kim (operator)")
    assert serious_faults(page) == []
    page.click("text=Write a note")
    assert page.input_value("#ask-user") == "Kim"
    page.fill("#ask-note", "looked at")
    page.click("#ask-ok")
    page.wait_for_selector('#diary :text("looked at")')
    revoke_token(tokens, "Kim")
    page.wait_for_selector("#token:visible")
    page.fill("#token", screen)
    page.press("#token", "Enter")
    page.wait_for_selector("#answer[data-condition=NORMAL]")
    page.click("text=Write a note")
    page.click("#ask-ok")
    page.wait_for_selector("text=this needs the role operator, yours is viewer")
    page.click("#ask-cancel")
    page.click("#sign-out")
    page.wait_for_selector("#token:visible")
    assert page.context.cookies() == []
    seen.faults[:] = [each for each in seen.faults if "40" not in each]  # refusals, as expected
