"""Tests of backup and restore: the service answers as it did before the loss."""

import asyncio
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import pytest

from edge_service.clock import now_ns
from edge_service.config import EdgeConfig, load_config
from edge_service.messages.topics import PRELOAD
from edge_service.offline.backup import BackupError, back_up, restore

from ..messages.examples import estimate_of
from .conftest import Running, done, served, until

LOST = estimate_of(0.5)
NS = 1_000_000_000
START_S = 1_769_818_834.5  # within a minute, so that its row is none of a minute or an hour
CONFIG = """
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
[store]
folder = "../history"
[[axes]]
name = "X"
machine = "machine.toml"
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "etc" / "edge.toml"
    path.parent.mkdir()
    path.write_text(CONFIG)
    shutil.copy(Path(__file__).parents[2] / "deploy" / "machine.toml", path.parent)
    return path


async def heard(client: httpx.AsyncClient) -> Any:
    """Condition of the axis, once the part that forms it has told it."""
    health = (await client.get("/api/v1/axes/X/health")).json()
    silent = any(reason.startswith("no_health") for reason in health["reasons"])
    return None if silent else health


async def answers(client: httpx.AsyncClient, until_ns: int) -> dict[str, Any]:
    """History of the axis up to a time."""
    span = {"from": f"{until_ns / 1e9 - 600.0:.3f}", "to": f"{until_ns / 1e9:.3f}"}
    kept = (await client.get("/api/v1/axes/X/history", params=span | {"step": 1})).json()
    log = (await client.get("/api/v1/log", params=span)).json()
    health = await until(partial(heard, client))
    return {
        "history": kept["buckets"],
        "log": log["items"],
        "alarms": [(each["alarm"], each["raised_at"]) for each in health["alarms"]],
    }


class Worn:
    """A service that reads a lost preload."""

    def __init__(self, service: Running, config: EdgeConfig, client: httpx.AsyncClient) -> None:
        self._publisher = service.bus.publisher(config.keys.key("X", PRELOAD), PRELOAD, "X")
        self._client = client

    async def is_told(self) -> bool:
        """True once the alarm is raised."""
        self._publisher.publish(LOST, now_ns())
        health = (await self._client.get("/api/v1/axes/X/health")).json()
        return any(each["alarm"] == "preload_lost" for each in health["alarms"])

    async def is_kept(self, after_ns: int) -> bool:
        """True once what was heard up to a time can be asked for."""
        self._publisher.publish(LOST, now_ns())
        span = {"from": f"{after_ns / 1e9:.3f}", "step": 1}
        kept = (await self._client.get("/api/v1/axes/X/history", params=span)).json()
        return len(kept["buckets"]) > 1


async def test_a_service_answers_what_it_answered(config: Path, tmp_path: Path) -> None:
    file, history = tmp_path / "backup.zip", tmp_path / "history"
    settings, nodes = load_config(config), ("http", "health")
    async with served(settings, nodes) as (service, client):
        axis = Worn(service, settings, client)
        await until(axis.is_told)
        note = {"action": "note", "user": "Kim", "note": "greased"}
        await done(client, "/api/v1/axes/X/commands", note, "1")
        at_ns = now_ns()
        await until(lambda: axis.is_kept(at_ns))
        before = await answers(client, at_ns)
        await asyncio.to_thread(back_up, config, file)
        with pytest.raises(BackupError, match="stop the service first"):
            await asyncio.to_thread(restore, file, config, force=True)
    shutil.rmtree(history)
    shutil.rmtree(config.parent)
    restore(file, config)
    assert all(before.values()), before
    settings = load_config(config)
    async with served(settings, nodes) as (_, client):
        assert await answers(client, at_ns) == before
