"""History, alarms and notes over a restart of the whole service, and many readers at once."""

import asyncio
import json
from pathlib import Path
from typing import Any

import httpx
import pytest

from edge_service.atomic import read_checked
from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, ConfigError
from edge_service.config_tables import HistoryConfig
from edge_service.nodes.stores.history_store import open_history
from edge_service.nodes.stores.watch_store import snapshot_path

from .conftest import config_of, running, until

HEALTHY = {"scenario": "healthy", "speed": 20.0}
READERS = 50
LIVE = 10


def state_in(path: Path) -> Any:
    """State that a file keeps."""
    return json.loads(read_checked(path) or "")


async def test_what_was_kept_is_there_after_a_restart(tmp_path: Path) -> None:
    config = config_of("simulated", HEALTHY, history=HistoryConfig(folder=tmp_path))
    async with running(config) as service:
        address = await asyncio.wait_for(service.address, 20.0)
        async with httpx.AsyncClient(base_url=address) as client:

            async def estimated() -> Any:
                answer = (await client.get("api/v1/axes/X/preload")).json()
                return answer["status"] == "estimated"

            await until(estimated)
            body = {"action": "note", "user": "Kim", "note": "greased"}
            await client.post("api/v1/axes/X/commands", json=body)

            async def noted() -> Any:
                events = (await client.get("api/v1/axes/X/log")).json()["events"]
                return [event for event in events if event["kind"] == "note"]

            (note,) = await until(noted)
            way_m = (await client.get("api/v1/axes/X/use")).json()["distance_m"]
    assert state_in(snapshot_path(tmp_path, "X"))["axis"] == "X"
    async with running(config) as service:
        address = await asyncio.wait_for(service.address, 20.0)
        async with httpx.AsyncClient(base_url=address) as client:
            buckets = (await client.get("api/v1/axes/X/history")).json()["buckets"]
            assert sum(bucket["estimated"] for bucket in buckets) > 0
            assert note in (await client.get("api/v1/axes/X/log")).json()["events"]

            async def counted() -> Any:
                use = (await client.get("api/v1/axes/X/use")).json()
                return use and use["distance_m"] >= way_m > 0.0

            await until(counted)


async def test_one_folder_has_one_service(tmp_path: Path) -> None:
    config = config_of("simulated", HEALTHY, history=HistoryConfig(folder=tmp_path))
    first = open_history(config, {})
    with pytest.raises(ConfigError, match="in use by another service"):
        open_history(config, {})
    first.close()
    open_history(config, {}).close()


async def test_a_damaged_state_is_set_aside(tmp_path: Path) -> None:
    path = snapshot_path(tmp_path, "X")
    path.parent.mkdir()
    path.write_text("{")
    config = config_of("simulated", HEALTHY, history=HistoryConfig(folder=tmp_path))
    async with running(config) as service:
        address = await asyncio.wait_for(service.address, 20.0)
        async with httpx.AsyncClient(base_url=address) as client:

            async def alive() -> Any:
                return (await client.get("api/v1/axes/X/use")).json()

            await until(alive)
            events = (await client.get("api/v1/axes/X/log")).json()["events"]
            (damaged,) = [each for each in events if each["kind"] == "state_damaged"]
            assert "watch.json.damaged" in damaged["message"]
    assert path.with_name("watch.json.damaged").read_text() == "{"
    assert state_in(path)["axis"] == "X"


async def test_fifty_readers_get_every_event_while_one_reads_nothing() -> None:
    """Each of 49 readers sees all notes in order and live values all the while."""
    async with running(config_of("simulated", HEALTHY | {"speed": 1.0})) as service:
        address = await asyncio.wait_for(service.address, 20.0)
        host, port = address.removeprefix("http://").rstrip("/").split(":")
        _, silent = await asyncio.open_connection(host, int(port), limit=1024)
        silent.write(b"GET /api/v1/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        notes = [f"note {number} (Kim)" for number in range(5)]
        limits = httpx.Limits(max_connections=READERS + 5)
        async with httpx.AsyncClient(base_url=address, limits=limits, timeout=30.0) as client:
            readers = [asyncio.create_task(_notes(client, len(notes))) for _ in range(READERS - 1)]

            async def connected() -> bool:
                text = (await client.get("metrics")).text
                return f"edge_service_live_readers {float(READERS)}" in text

            await until(connected)
            for number in range(5):
                body = {"action": "note", "user": "Kim", "note": f"note {number}"}
                await client.post("api/v1/axes/X/commands", json=body)
            async with asyncio.timeout(30.0):
                heard = await asyncio.gather(*readers)
        silent.close()
    assert all(seen == notes for seen, _live in heard)
    assert min(live for _seen, live in heard) >= LIVE


async def _notes(client: httpx.AsyncClient, count: int) -> tuple[list[str], int]:
    """Notes that a reader sees, and how many live values with them."""
    seen: list[str] = []
    live, event = 0, ""
    async with client.stream("GET", "api/v1/events") as response:
        async for line in response.aiter_lines():
            name, _, value = line.partition(": ")
            if name == "event":
                event = value
                live += value == "live"
            elif name == "data" and event == "event":
                message = json.loads(value)
                seen += [message["message"]] if message["kind"] == "note" else []
            if len(seen) >= count and live >= LIVE:
                return seen, live
    return seen, live


@pytest.mark.parametrize(
    ("table", "said"),
    [("", "history in memory, it ends with the service"), ("[history]\nfolder = 'kept'", "kept")],
)
def test_check_config_says_where_history_lives(
    table: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "edge.toml"
    config.write_text(f"{table}\n[[axes]]\nname = 'X'\nmachine = '{DEFAULT_MACHINE}'\n")
    assert main(["check-config", str(config)]) == 0
    line = next(each for each in capsys.readouterr().out.splitlines() if "history" in each)
    assert said in line
    assert not (tmp_path / "kept").exists()
