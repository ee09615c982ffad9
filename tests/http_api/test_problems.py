"""Errors, headers and host names."""

import re
from pathlib import Path

import httpx
import pytest

from edge_service.health.store.store import Store, StoreFailedError
from edge_service.http_api.app import STATIC, static_digest
from edge_service.http_api.guard import SECURITY_HEADERS

TIME = re.compile(r"[. ](time|since|from|to|started|ended|earliest|likely|latest|\w+_(at|until))$")


@pytest.mark.parametrize(
    ("status", "method", "paths"),
    [
        (404, "GET", "/nothing /redoc /static/x/nothing.js /static/x/app.js /api/v1/events?axis=Q"),
        (404, "GET", "/api/v1/axes/Q/preload /api/v1/axes/Q/health /api/v1/axes/Q/history"),
        (422, "GET", "/api/v1/axes?more=1 /api/v1/events?last_event_id=last"),
        (405, "POST", "/api/v1/axes"),
        (405, "DELETE", "/"),
        (503, "GET", "/readyz"),
    ],
)
async def test_every_error_is_a_problem_document(client, status, method, paths):
    for path in paths.split():
        answer = await client.request(method, path)
        assert answer.status_code == status
        assert answer.headers["content-type"] == "application/problem+json"
        problem = answer.json()
        assert {"type", "title", "status", "detail", "instance"} <= set(problem)
        assert problem["status"] == status
        assert problem["title"] == httpx.codes.get_reason_phrase(status)
        assert ("retry-after" in answer.headers) == (status in (429, 503))
        assert problem["instance"] == path.partition("?")[0].replace("%2f", "/")


async def test_405_says_what_is_allowed(client):
    assert (await client.post("/api/v1/axes")).headers["allow"] == "GET, HEAD"
    answer = await client.patch("/api/v1/recordings/a.csv")
    assert answer.headers["allow"] == "DELETE, GET, HEAD, PUT"


async def test_failure_says_nothing_about_the_inside(scene, client, monkeypatch):
    def fail(now_ns: int) -> None:
        raise RuntimeError("secret")

    monkeypatch.setattr(scene.state, "unready", fail)
    answer = await client.get("/readyz")
    assert (answer.status_code, answer.headers["content-type"]) == (500, "application/problem+json")
    assert "secret" not in answer.text
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("path", ["/", "/static/app.js", "/api/v1/axes", "/metrics", "/nothing"])
async def test_security_headers_are_everywhere(client, path):
    headers = (await client.get(path)).headers
    for name, value in SECURITY_HEADERS.items():
        assert headers[name] == value
    assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    ("hosts", "status"),
    [
        ("127.0.0.1 127.0.0.1:8080 LOCALHOST:1 [::1]:8080 [::1]", 200),
        ("evil.example 127.0.0.1.evil.example localhost:8080@evil.example testserver ", 400),
    ],
)
async def test_only_loopback_names_are_answered(client, hosts, status):
    for host in hosts.split(" "):
        assert (await client.get("/healthz", headers={"host": host})).status_code == status


async def test_description_documents_every_route_and_the_problems(scene, client):
    schema = (await client.get("/openapi.json")).json()
    assert schema["openapi"].startswith("3.")
    assert {"/healthz", "/readyz", "/metrics", "/api/v1/axes", "/api/v1/events"} <= set(
        schema["paths"]
    )
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            assert operation["description"], (method, path)
            assert "application/problem+json" in operation["responses"]["default"]["content"]
    assert {"Problem", "PreloadAnswer", "HistoryAnswer"} <= set(schema["components"]["schemas"])
    assert "HTTPValidationError" not in schema["components"]["schemas"]


async def test_page_asks_for_nothing_outside_and_runs_nothing_inline(client):
    page = (await client.get("/")).text
    assert "<script>" not in page
    assert "style=" not in page
    for file in filter(Path.is_file, STATIC.rglob("*")):
        text = file.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        if not file.name.startswith("uplot."):  # it names its home in a comment
            assert "http://" not in text, file.name
            assert "https://" not in text, file.name
        answer = await client.get(f"/static/{static_digest()}/{file.relative_to(STATIC)}")
        assert answer.status_code == 200
        assert "immutable" in answer.headers["cache-control"]


@pytest.mark.parametrize("path", ["axes/X/history", "axes/X/history?format=csv", "log"])
async def test_a_history_that_cannot_be_read_now_is_no_failure_of_the_service(
    client, monkeypatch, path
):
    def fail(*_: object) -> None:
        raise StoreFailedError("a.sqlite: Too many open files")

    monkeypatch.setattr(Store, "read", fail)
    answer = await client.get(f"/api/v1/{path}")
    assert answer.status_code == 503
    assert (
        answer.json()["detail"] == "the history cannot be read now (a.sqlite: Too many open files)"
    )
