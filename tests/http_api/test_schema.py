"""The running service against its own schema, its versions, and hostile requests to its routes."""

import asyncio
import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import httpx
import pytest

from edge_service import process
from edge_service.config import DEFAULT_MACHINE, load_config
from edge_service.health.service_state import ServiceState
from edge_service.health.store.store import Store
from edge_service.http_api import guard
from edge_service.http_api.app import create_app, rendered
from edge_service.http_api.guard import SECURITY_HEADERS
from edge_service.http_api.jobs import Jobs
from edge_service.http_api.recordings import Recordings
from tests.programs import ran, serving

from ..documents import ROOT, document
from .hostile_requests import HostileRequest, hostile_requests
from .test_limits import connected, served

LONGEST_S = 30
MISSING = find_spec("schemathesis") is None and "EDGE_SERVICE_CHECK" not in os.environ
STREAM = "/api/v1/events"
REPORT = "report.json"
README = "edge_service/http_api/README.md"


@pytest.mark.slow
@pytest.mark.skipif(MISSING, reason="schemathesis is not installed; deploy/check.sh does it")
def test_every_route_keeps_what_its_schema_says(tmp_path: Path) -> None:
    """All routes but the live stream, which has no end.

    Not checked: that every request the schema allows is taken. No schema says that `from` lies
    before `to`, or that a comparison needs two recordings. A fresh service has no jobs and no
    dead letters: their routes answer mostly that there is none.
    """
    line = (sys.executable, "-m", "edge_service", "run", "--port", "0", "--bus", "tcp/127.0.0.1:0")
    with serving(*line, folder=tmp_path) as printed:
        address = printed.readline().split()[2]
        assert httpx.get(f"{address}openapi.json", timeout=120.0).status_code == 200
        said = _examined(f"{address}openapi.json", tmp_path)
    assert said.returncode == 0, said.stdout[-4000:] + said.stderr[-4000:]
    routes = json.loads((tmp_path / REPORT).read_text())["operations"]
    assert routes["tested"] == routes["total"] - 1, routes


def _examined(schema: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    options = ["--max-time", str(LONGEST_S), "--max-examples", "8", "--seed", "1", "--no-color"]
    options += ["--exclude-path", STREAM, "--request-timeout", "30"]
    options += ["--exclude-checks", "positive_data_acceptance"]
    options += ["--report", "json", "--report-json-path", REPORT]
    return ran(sys.executable, "-m", "schemathesis.cli", "run", schema, *options, folder=folder)


CONFIG = '[service]\nmachine = "mill"\n[[axes]]\nname = "X"\nmachine = "machines/x.toml"\n'


def installed(folder: Path, name: str = "edge.toml") -> Path:
    (folder / "machines").mkdir(parents=True)
    (folder / "machines/x.toml").write_text((ROOT / "deploy" / "machine.toml").read_text())
    (folder / name).write_text(CONFIG)
    return folder / name


def test_equal_files_have_equal_digests_wherever_they_lie(tmp_path: Path) -> None:
    one = load_config(installed(tmp_path / "a"))
    other = load_config(installed(tmp_path / "b", "mill.toml"))
    assert one.digest == other.digest == one.model_copy(update={"axes": ()}).digest
    assert len(one.digest) == 12


@pytest.mark.parametrize("name", ["edge.toml", "machines/x.toml"])
def test_a_changed_file_changes_the_digest(tmp_path: Path, name: str) -> None:
    config = installed(tmp_path)
    before = load_config(config).digest
    with (tmp_path / name).open("a") as file:
        file.write("# changed\n")
    assert load_config(config).digest != before


COUNT, AT_ONCE = 1500, 20


async def _status(port: int, request: HostileRequest) -> bytes:
    """The status; the live stream is left at its first bytes."""
    async with connected(port) as client:
        client.send(request.raw("127.0.0.1"))
        answer = await client.some()
    return answer[9:12]


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
async def test_no_request_is_answered_by_a_failure(
    scene, tmp_path: Path, caplog, monkeypatch, seed: int
):
    scene.hear_all()
    kept = Recordings(tmp_path / "recordings", 1 << 20)
    machines = {"X": DEFAULT_MACHINE, "Y": DEFAULT_MACHINE}
    jobs = Jobs(Store(None), tmp_path / "jobs", kept, machines)
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "a.csv").write_text("time_s\n")
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-S", "-c", ""))
    description = create_app(scene.state, lambda: 0).openapi()
    monkeypatch.setattr(guard, "BODY_IDLE_S", 0.5)
    seen: dict[bytes, HostileRequest] = {}
    async with served(scene, jobs=jobs, recordings=kept) as port:
        asking = islice(hostile_requests(description, seed), COUNT // 2)
        while batch := list(islice(asking, AT_ONCE)):
            statuses = await asyncio.gather(*(_status(port, each) for each in batch))
            seen |= dict(zip(statuses, batch, strict=True))
    await jobs.close()
    assert set(seen) >= {b"200", b"404", b"405", b"413", b"422"}
    assert [seen[each] for each in seen if each[:1] == b"5" and each not in (b"503", b"507")] == []
    assert "Exception" not in caplog.text
    assert len(list(tmp_path.rglob("*.csv"))) <= 5


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
    assert (answer.status_code, answer.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert answer.headers["content-security-policy"] == SECURITY_HEADERS["content-security-policy"]
