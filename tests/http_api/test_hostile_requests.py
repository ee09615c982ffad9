"""Hostile requests to every route of the description: a problem document, never a failure."""

import asyncio
import sys
from itertools import islice
from pathlib import Path

import pytest

from edge_service import process
from edge_service.config import DEFAULT_MACHINE
from edge_service.health.store.store import Store
from edge_service.http_api import guard
from edge_service.http_api.app import create_app
from edge_service.http_api.jobs import Jobs
from edge_service.http_api.recordings import Recordings

from .hostile_requests import HostileRequest, hostile_requests
from .test_limits import connected, served

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
