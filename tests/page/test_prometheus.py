"""Prometheus of Debian scrapes the real service; the Grafana dashboard asks for what is there."""

import asyncio
import json
import re
import shutil
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

import httpx
import pytest

from edge_service.outputs.metrics import family_names

from ..nodes.conftest import until

ROOT = Path(__file__).parents[2]
PROMETHEUS = shutil.which("prometheus")
PRELOAD = 'edge_service_preload_rating_ratio{bound="value"}'


def asked_by_grafana() -> list[str]:
    dashboard = json.loads((ROOT / "deploy" / "grafana.json").read_text())
    return [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def test_the_dashboard_asks_only_for_what_is_there() -> None:
    asked = set(re.findall(r"edge_service_[a-z_]+", " ".join(asked_by_grafana())))
    assert asked <= set(family_names())


def started(folder: Path) -> tuple["subprocess.Popen[bytes]", int]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    line = [
        str(PROMETHEUS),
        f"--config.file={folder / 'prometheus.yml'}",
        f"--storage.tsdb.path={folder / 'tsdb'}",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(line, **quiet), port


@pytest.mark.slow
async def test_prometheus_scrapes_it(make_service: Any, tmp_path: Path) -> None:
    if PROMETHEUS is None:
        pytest.skip("prometheus is not installed")
    service = await asyncio.to_thread(lambda: make_service(scenario="healthy", speed=10.0))
    config = (ROOT / "deploy" / "prometheus.yml").read_text()
    target = service.address.removeprefix("http://").rstrip("/")
    config = config.replace("127.0.0.1:8080", target).replace("5s", "200ms")
    (tmp_path / "prometheus.yml").write_text(config)
    process, port = await asyncio.to_thread(started, tmp_path)
    try:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{port}") as client:
            (series,) = await until(lambda: _answer(client, PRELOAD))
            assert series["metric"]["axis"] == "X"
            assert 0.05 < float(series["value"][1]) < 0.09
            (up,) = await _answer(client, "up")
            assert up["value"][1] == "1"
            assert await _answer(client, "edge_service_distance_meters_total")
            for question in asked_by_grafana():
                query = {"query": question.replace("$axis", ".*")}
                assert (await client.get("/api/v1/query", params=query)).is_success, question
            condition = asked_by_grafana()[0].replace("$axis", ".*")
            assert (await _answer(client, condition))[0]["value"][1] in "01"
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(20.0)


async def _answer(client: httpx.AsyncClient, query: str) -> list[dict[str, Any]]:
    try:
        answer = await client.get("/api/v1/query", params={"query": query})
    except httpx.TransportError:
        return []
    result: list[dict[str, Any]] = answer.json()["data"]["result"] if answer.is_success else []
    return result
