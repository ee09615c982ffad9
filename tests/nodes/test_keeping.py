"""History, alarms and notes over a restart of the whole service, and many readers at once."""

import json
from pathlib import Path
from typing import Any

from edge_service.clock import now_ns
from edge_service.config_tables import StoreConfig
from edge_service.health.store.store import FILE_NAME
from edge_service.messages.topics import PRELOAD

from ..messages.examples import estimate_of
from .conftest import config_of, done, once, served, until

HEALTHY = {"scenario": "healthy", "speed": 20.0}


NOTES = {"axis": "X", "kind": "note"}


async def test_a_store_that_cannot_be_read_is_waited_for_said_and_left_as_it_is(
    tmp_path: Path,
) -> None:
    """Rights of another user after a restore: latched alarms are not forgotten."""
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    path, elsewhere, nodes = tmp_path / FILE_NAME, tmp_path / "elsewhere", ("http", "health")
    note = {"action": "note", "user": "Kim", "note": "greased"}
    async with served(config, nodes) as (_, client):
        await done(client, "api/v1/axes/X/commands", note, key="a")
    path.rename(elsewhere)
    path.mkdir()
    async with served(config, nodes) as (_, client):
        for page in ("readyz", "api/v1/health", "api/v1/log"):
            answer = await client.get(page)
            assert answer.status_code == 503
            assert "Is a directory" in answer.json()["detail"]
        assert (await client.get("healthz")).status_code == 200
        path.rmdir()
        elsewhere.rename(path)
        (found,) = await once(client, "log?axis=X&kind=note", lambda log: log["items"])
        assert found["text"] == "greased (Kim)"
        again = await done(client, "api/v1/axes/X/commands", note, key="a")
        assert again.json()["outcome"] == "greased (Kim)"
        assert len((await client.get("api/v1/log", params=NOTES)).json()["items"]) == 1
    assert not list(tmp_path.glob("*damaged*"))


async def test_who_asks_on_the_bus_is_answered_as_by_http() -> None:
    config = config_of("simulated", HEALTHY)
    async with served(config, ("http",)) as (service, client):
        publisher = service.bus.publisher(config.keys.key("X", PRELOAD), PRELOAD, "X")

        async def asked(selector: str) -> Any:
            key = f"{config.keys.root}/X/history?{selector}"
            answer = await service.bus.ask(key, None, 10.0)
            return json.loads(answer or b"null")

        async def kept() -> Any:
            publisher.publish(estimate_of(), now_ns())
            return (await client.get("api/v1/axes/X/history")).json()["buckets"]

        (first, *_) = await until(kept)
        span = {"from": first["time"], "to": "2100-01-01T00:00:00Z", "step": "86400000"}
        by_http = (await client.get("api/v1/axes/X/history", params=span)).json()
        by_bus = await asked(";".join(f"{name}={value}" for name, value in span.items()))
        for each in (by_http, by_bus):
            assert each["axis"] == "X"
            assert [bucket["time"] for bucket in each["buckets"]] == [first["time"]]
        assert set(by_http) == set(by_bus)
        assert "more than 5000" in (await asked("from=0;step=1"))["detail"]
        assert "speed: unknown" in (await asked("speed=1"))["detail"]
