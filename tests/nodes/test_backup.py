"""What a service answers, it answers again after backup, loss and restore."""

import asyncio
import shutil
from contextlib import closing
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import httpx
import pytest

from edge_service.clock import now_ns
from edge_service.config import ConfigError, EdgeConfig, load_config
from edge_service.health.events.diary import Diary
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event, Severity
from edge_service.messages.topics import PRELOAD
from edge_service.nodes.stores.diary_store import DIARY
from edge_service.nodes.stores.history_store import open_history
from edge_service.offline.backup import backup
from edge_service.offline.backup.contents import KeptFile
from edge_service.offline.backup.restore import restore

from .conftest import Running, done, running, until

LOST = PreloadEstimate(
    time_s=0.0, status=EstimateStatus.ESTIMATED, preload_percent=0.5, low=0.4, high=0.6
)
NS = 1_000_000_000
START_S = 1_769_818_834.5  # within a minute, so that its row is none of a minute or an hour
CONFIG = """
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
[history]
folder = "../history"
[[axes]]
name = "X"
machine = "machine.toml"
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration with its machine file in a folder of its own."""
    path = tmp_path / "etc" / "edge.toml"
    path.parent.mkdir()
    path.write_text(CONFIG)
    shutil.copy(Path(__file__).parents[2] / "deploy" / "machine.toml", path.parent)
    return path


async def answers(client: httpx.AsyncClient, until_ns: int) -> dict[str, Any]:
    """History of the axis up to a time."""
    span = {"from": f"{until_ns / 1e9 - 600.0:.3f}", "to": f"{until_ns / 1e9:.3f}"}
    kept = (await client.get("/api/v1/axes/X/history", params=span | {"step": 1})).json()
    log = (await client.get("/api/v1/axes/X/log", params=span)).json()
    health = (await client.get("/api/v1/axes/X/health")).json()
    return {
        "history": kept["buckets"],
        "log": log["events"],
        "alarms": [(each["alarm"], each["raised_at"]) for each in health["alarms"]],
    }


def client_of(address: str) -> httpx.AsyncClient:
    return httpx.AsyncClient(base_url=address, trust_env=False, timeout=30.0)


class Worn:
    """A service that reads a lost preload."""

    def __init__(self, service: Running, config: EdgeConfig, client: httpx.AsyncClient) -> None:
        self._publisher = service.bus.publisher(config.keys.key("X", PRELOAD), PRELOAD, "X")
        self._client = client
        folder = config.history.folder
        assert folder is not None
        self._log = folder / "axis=X" / "open.log"

    async def is_told(self) -> bool:
        """Tell whether the alarm is raised."""
        self._publisher.publish(LOST, now_ns())
        health = (await self._client.get("/api/v1/axes/X/health")).json()
        return any(each["alarm"] == "preload_lost" for each in health["alarms"])

    async def is_kept(self, after_ns: int) -> bool:
        """Tell whether what was heard up to a time is in the file."""
        self._publisher.publish(LOST, now_ns())
        return self._log.is_file() and self._log.stat().st_mtime_ns > after_ns


async def test_a_service_answers_what_it_answered(config: Path, tmp_path: Path) -> None:
    file, history = tmp_path / "backup.zip", tmp_path / "history"
    settings, nodes = load_config(config), ("http", "health")
    async with running(settings, nodes) as service, client_of(await service.address) as client:
        axis = Worn(service, settings, client)
        await until(axis.is_told)
        note = {"action": "note", "user": "Kim", "note": "greased"}
        await done(client, "/api/v1/axes/X/commands", note, "1")
        at_ns = now_ns()
        await until(lambda: axis.is_kept(at_ns))
        before = await answers(client, at_ns)
        await asyncio.to_thread(backup.back_up, config, file)
        with pytest.raises(ConfigError, match="in use by another service"):
            await asyncio.to_thread(restore, file, None, history)
    shutil.rmtree(history)
    shutil.rmtree(config.parent)
    restore(file, config, history)
    assert all(before.values()), before
    settings = load_config(config)
    async with running(settings, nodes) as service, client_of(await service.address) as client:
        assert await answers(client, at_ns) == before


def test_what_was_written_before_a_backup_is_in_it_while_more_is_written(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before each file of the history is copied an hour is over: its log becomes other files."""
    settings = load_config(config)
    store, copy, times = open_history(settings, {}), backup._add, list[int]()
    with closing(Diary(tmp_path / "history" / DIARY)) as diary:

        def write() -> None:
            at_ns = round((START_S + 3600.0 * len(times)) * NS)
            store.keeping.archives["X"].append(at_ns, LOST)
            assert store._turn(sync=True).problems == []
            event = Event(axis="X", kind="note", severity=Severity.INFO, message="-", time_ns=at_ns)
            diary.add((event,), at_ns)
            times.append(at_ns)

        def late(archive: ZipFile, path: Path, name: str) -> KeptFile:
            if name.startswith("history") and len(times) < 20:
                write()
            return copy(archive, path, name)

        for _ in range(9):  # the last one is in the log, and will be elsewhere
            write()
        known = tuple(times)
        monkeypatch.setattr(backup, "_add", late)
        backup.back_up(config, tmp_path / "backup.zip")
        assert len(times) == 20
    store.close()
    check_whole(settings, known, tmp_path / "backup.zip", tmp_path / "new")


def check_whole(config: EdgeConfig, known: tuple[int, ...], file: Path, folder: Path) -> None:
    """A backup holds each row and event once that was there before, in order."""
    restore(file, None, folder)
    kept = config.history.model_copy(update={"folder": folder})
    store = open_history(config.model_copy(update={"history": kept}), {})
    rows = store.keeping.archives["X"].rows(START_S - 1.0, START_S + 1e7, 0.1)
    assert {round(each * NS) for each in rows.time_s} >= set(known)
    store.close()
    with closing(Diary(folder / DIARY)) as diary:
        assert diary.problem == ""
        noted = [each.event.time_ns for each in diary.between(0, 2**62, "X", 10_000)]
    assert noted[: len(known)] == list(known)
    assert not list(folder.rglob("*.damaged"))
