"""Answers that come late, for another axis or not at all, on the page in a real browser."""

import re
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

HEALTHY = {"scenario": "healthy"}
HUGE = 7.77e9
ASKED = "overview live?duration=60,why wear,why history,history history,history wear"


def grown(answer: Any) -> Any:
    """Every fraction of an answer replaced by what no axis of the tests can have."""
    if isinstance(answer, dict):
        return {key: each if key == "time_s" else grown(each) for key, each in answer.items()}
    if isinstance(answer, list):
        return [grown(each) for each in answer]
    return HUGE if isinstance(answer, float) else answer


def said(page: Any, tab: str) -> str:
    labels = page.eval_on_selector_all(
        f"#{tab} [aria-label]", "nodes => nodes.map((node) => node.getAttribute('aria-label'))"
    )
    return "\n".join([page.inner_text(f"#{tab}"), *labels])


@pytest.mark.slow
@pytest.mark.parametrize(("tab", "asked"), [each.split() for each in ASKED.split(",")])
def test_a_late_answer_never_stands_under_another_axis(
    make_service: Any, open_page: Any, tab: str, asked: str
) -> None:
    page = open_page(make_service(axes=dict.fromkeys("XY", HEALTHY)).address).page
    page.wait_for_selector("#machine-answer[data-level=NORMAL]")
    held: list[Any] = []

    def hold(route: Any) -> None:
        held.append((route, route.fetch()))

    page.route(lambda url: f"/axes/X/{asked}" in url, hold)
    with page.expect_request(lambda request: f"/axes/X/{asked}" in request.url):
        page.evaluate(f"location.hash = '#/X/{tab}'")
    with page.expect_response(lambda response: f"/axes/Y/{asked}" in response.url):
        page.evaluate(f"location.hash = '#/Y/{tab}'")
    for route, answer in held:
        with page.expect_response(lambda response: f"/axes/X/{asked}" in response.url):
            route.fulfill(response=answer, json=grown(answer.json()))
    page.evaluate("new Promise((done) => setTimeout(done, 300))")  # one drawing more
    assert held
    assert not re.search(r"\d(,\d{3}){2}", said(page, tab))


def job(number: int, state: str, begun_s: float, ended_s: float | None = None) -> dict[str, Any]:
    """A diagnosis as the service tells of it; times are before now, s."""

    def ago(span_s: float | None) -> str | None:
        moment = datetime.now(UTC)
        return None if span_s is None else (moment - timedelta(seconds=span_s)).isoformat()

    return {
        "id": number,
        "command": "diagnose",
        "axis": "X",
        "recordings": ["a.csv"],
        "options": {"duration_s": None, "baseline": None},
        "state": state,
        "started": ago(begun_s),
        "ended": ago(ended_s),
        "stage": "choosing causes",
        "share": 0.4 if state == "running" else None,
        "left_s": 30.0 if state == "running" else None,
        "verdict": None,
        "lines": ["reading a.csv"],
        "files": ["diagnosis.json"] if state == "done" else [],
    }


def running() -> list[dict[str, Any]]:
    return [job(2, "running", 20.0), job(1, "done", 300.0, 200.0)]


FOUND = {"verdict": "explained", "effects": []}


@pytest.mark.slow
def test_a_test_belongs_to_the_axis_that_is_shown(make_service: Any, open_page: Any) -> None:
    """While another axis still records and its job still runs."""
    page = open_page(make_service(axes=dict.fromkeys("XY", HEALTHY)).address).page
    live = job(3, "running", 3.0) | {"command": "record", "share": 0.05}
    live["options"] = {"duration_s": 60.0, "baseline": None}
    listed = {"items": [live, *running()]}
    page.route("**/api/v1/jobs", lambda route: route.fulfill(json=listed))
    page.route("**/diagnosis.json", lambda route: route.fulfill(json=FOUND))
    page.evaluate("location.hash = '#/X/tests'")
    page.wait_for_selector("#step-record :text('Axis X: 3 s of 60 s recorded.')")
    page.evaluate("location.hash = '#/Y/tests'")
    for _ in range(3):
        with page.expect_response("**/api/v1/jobs"):
            pass
    assert "X" not in page.inner_text("#step-record")
    assert "is in the list below" not in page.inner_text("#step-record")
    with page.expect_request(lambda request: request.method == "POST") as begun:
        page.click("#record-start")
    assert begun.value.post_data_json["axis"] == "Y"


def test_a_verdict_that_comes_late_is_shown(make_service: Any, open_page: Any) -> None:
    page = open_page(make_service(**HEALTHY).address).page
    held: list[Any] = []

    def hold(route: Any) -> None:
        held.append(route)

    page.route("**/api/v1/jobs", lambda route: route.fulfill(json={"items": running()[1:]}))
    page.route("**/diagnosis.json", hold)
    with page.expect_request("**/diagnosis.json"):
        page.evaluate("location.hash = '#/X/tests'")
    page.evaluate("location.hash = '#/service'")
    page.wait_for_selector("#service:visible")
    with page.expect_response("**/api/v1/recordings"):
        page.evaluate("location.hash = '#/X/tests'")
    page.evaluate("new Promise((done) => setTimeout(done, 300))")
    for route in held:
        route.fulfill(json=FOUND)
    page.wait_for_selector("#jobs .job-verdict:has-text('is explained')")


@pytest.mark.parametrize("typed", ["#/%", "#/X/%E0%A4%A"])
def test_an_address_that_is_no_address_still_shows_the_axis(
    make_service: Any, open_page: Any, typed: str
) -> None:
    page = open_page(f"{make_service(**HEALTHY).address}{typed}").page
    page.wait_for_selector("#answer[data-level=NORMAL]")


def test_a_note_is_written_over_plain_http(make_service: Any, open_page: Any) -> None:
    """From another host a browser gives such a page no `crypto.randomUUID`."""
    page = open_page(f"{make_service(**HEALTHY).address}#/X/history").page
    page.add_init_script("delete Crypto.prototype.randomUUID")
    page.reload()
    keys = []
    for word in ("greased", "cleaned"):
        page.get_by_role("button", name="Write a note").click()
        page.fill("#ask-user", "Kim")
        page.fill("#ask-note", word)
        with page.expect_request("**/commands") as sent:
            page.press("#ask-user", "Enter")
        keys.append(sent.value.headers["idempotency-key"])
        page.wait_for_selector(f"text={word} (Kim)")
    assert keys[0] != keys[1]
