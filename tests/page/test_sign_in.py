"""The page behind a token: the browser asks for it once, as the password of HTTP Basic."""

from pathlib import Path
from typing import Any

import pytest

from edge_service.config import HttpConfig
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.health.store.tokens import Tokens
from tests.certificates import write_certificates

from .conftest import serious_faults, show_tab


def lose_the_answer(route: Any) -> None:
    assert route.fetch().status == 202
    route.abort()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["https", "http"])
def test_a_person_is_known_by_the_token(
    scheme: str, make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    tokens = Tokens(Store(tmp_path / FILE_NAME))
    kim = tokens.add("Kim", "operator", 0)
    tokens.add("screen", "viewer", 0)
    pair = dict.fromkeys(("certificate", "private_key"))
    if scheme == "https":
        pair["certificate"], pair["private_key"] = write_certificates(tmp_path)
    service = make_service(HttpConfig(**pair), scenario="healthy")
    assert service.address.startswith(f"{scheme}://")
    seen = open_page(
        service.address,
        bypass_csp=True,
        ignore_https_errors=True,
        http_credentials={"username": "whoever", "password": kim},
    )
    page = seen.page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    assert serious_faults(page) == []
    assert page.context.cookies() == []
    show_tab(page, "history")
    page.click("text=Write a note")
    assert page.input_value("#ask-user") == "Kim"
    assert not page.is_editable("#ask-user")
    page.fill("#ask-note", "looked at")
    page.route("**/commands", lose_the_answer, times=1)
    page.click("#ask-ok")
    page.wait_for_selector("#ask-error:has-text('It was not accepted')")
    page.click("#ask-ok")
    page.wait_for_selector("#ask", state="hidden")
    page.wait_for_selector('#diary :text("looked at (Kim)")')
    assert page.locator('#diary :text("looked at (Kim)")').count() == 1
    tokens.revoke("Kim")
    page.wait_for_selector("#banner:visible")  # the live stream has ended
    seen.faults[:] = [each for each in seen.faults if "40" not in each and "ERR_FAILED" not in each]


@pytest.mark.slow
def test_a_viewer_is_told_what_an_operator_may(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    screen = Tokens(Store(tmp_path / FILE_NAME)).add("screen", "viewer", 0)
    service = make_service(scenario="healthy")
    seen = open_page(service.address, http_credentials={"username": "", "password": screen})
    page = seen.page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    show_tab(page, "history")
    page.click("text=Write a note")
    page.fill("#ask-note", "looked at")
    page.click("#ask-ok")
    page.wait_for_selector("#ask-error:has-text('this needs the role operator')")
    seen.faults[:] = [each for each in seen.faults if "status of 403" not in each]
