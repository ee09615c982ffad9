"""The page of the interface: whole, without network, and safe whatever a description says."""

import re
from typing import Any

import httpx
import pytest

from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app, rendered
from edge_service.http_api.guard import SECURITY_HEADERS

from ..documents import document

README = "edge_service/http_api/README.md"


@pytest.fixture(scope="module")
def description() -> dict[str, Any]:
    return create_app(ServiceState({"X": None}, 0), lambda: 0).openapi()


@pytest.fixture(scope="module")
def page(description: dict[str, Any]) -> str:
    return rendered(description)


def test_every_route_and_shape_stands_on_it(page: str, description: dict[str, Any]) -> None:
    for path, operations in description["paths"].items():
        for method, operation in operations.items():
            assert f"<h2>{method.upper()} {path}</h2>" in page
            for each in operation.get("parameters", ()):
                assert f"<td><code>{each['name']}</code></td>" in page
    for name, shape in description["components"]["schemas"].items():
        assert f'<section class="panel" id="{name}">' in page
        assert all(f"<code>{member}</code>" in page for member in shape.get("properties", ()))


def test_the_table_of_routes_is_the_description(description: dict[str, Any]) -> None:
    rows = re.findall(r"(?m)^\| `([A-Z ]+) (/\S+?)(?:\?(\S+))?` \|", document(README))
    stated = {
        (method, path, frozenset(re.findall(r"(\w+)=", query)))
        for methods, path, query in rows
        for method in methods.split()
    }
    assert stated == {
        (method.upper(), path, frozenset(_queries(operation)))
        for path, operations in description["paths"].items()
        for method, operation in operations.items()
    }


def _queries(operation: dict[str, Any]) -> list[str]:
    return [each["name"] for each in operation.get("parameters", ()) if each["in"] == "query"]


def test_every_link_leads_somewhere(page: str) -> None:
    places = re.findall(r'id="([^"]+)"', page)
    assert len(places) == len(set(places))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(places)


def test_nothing_is_loaded_that_the_policy_forbids(page: str) -> None:
    assert "style-src 'self'" in SECURITY_HEADERS["content-security-policy"]
    loaded = re.findall(r'<(?:link|script|img)[^>]*(?:href|src)="([^"]+)"', page)
    assert loaded
    assert all(each.startswith("/static/") for each in loaded)
    assert not re.search(r"<style|style=|<script|\son\w+=", page)


def test_a_description_is_text() -> None:
    strange = "<script>alert(1)</script> `<b>`"
    said = {"200": {"description": strange}}
    operation = {"summary": strange, "description": strange, "responses": said}
    shape = {"description": strange, "properties": {strange: {"type": "string", "enum": [strange]}}}
    page = rendered(
        {
            "info": {"title": strange, "version": "1", "summary": strange},
            "paths": {"/a": {"get": operation}},
            "components": {"schemas": {"Shape": shape}},
        }
    )
    assert "<script" not in page
    assert "<code>&lt;b&gt;</code>" in page


async def test_it_is_served_as_a_page(client: httpx.AsyncClient) -> None:
    answer = await client.get("/docs")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["content-security-policy"] == SECURITY_HEADERS["content-security-policy"]
