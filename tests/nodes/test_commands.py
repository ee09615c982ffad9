"""Commands through the whole service: answered by what came of them."""

from pathlib import Path

import pytest

from edge_service.config_tables import StoreConfig
from edge_service.messages.health import Command
from edge_service.messages.topics import COMMAND, OUTCOME
from edge_service.nodes.context import header

from .conftest import PATIENCE_S, config_of, done, served

HEALTHY = {"scenario": "healthy", "speed": 20.0}
NOTE = {"action": "note", "user": "Kim", "note": "greased"}
PATH = "api/v1/axes/X/commands"


async def test_without_a_monitor_no_command_is_accepted_and_none_is_lost(tmp_path: Path) -> None:
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    alone: tuple[str, ...] = ("http",)
    async with served(config, alone) as (_, client):
        answer = await client.post(PATH, json=NOTE)
        assert answer.status_code == 503
        assert "does not answer" in answer.json()["detail"]
        assert (await client.get("api/v1/log")).json()["items"] == []


@pytest.mark.parametrize("folder", [True, False], ids=["on disk", "in memory"])
async def test_a_command_is_answered_when_it_is_done(folder: bool, tmp_path: Path) -> None:
    store = StoreConfig(folder=tmp_path if folder else None)
    async with served(config_of("simulated", HEALTHY, store=store)) as (_, client):
        answer = await done(client, PATH, NOTE, key="a")
        assert answer.json() == {"outcome": "greased (Kim)"}
        (note,) = (await client.get("api/v1/log?kind=note")).json()["items"]
        assert (note["text"], note["who"]) == ("greased (Kim)", "Kim")
        for action, more in (("acknowledge", {"occurrence": 1}), ("unshelve", {})):
            body = {"action": action, "alarm": "sudden_drop", "user": "Kim"}
            answer = await client.post(PATH, json=body | more)
            assert answer.status_code == 409, action
            assert "sudden_drop" in answer.json()["detail"]
        refused = (await client.get("api/v1/log?kind=command")).json()["items"]
        assert [(each["who"], each["origin"]) for each in refused] == [("Kim", "127.0.0.1")] * 2
        assert [each["data"]["action"] for each in refused] == ["unshelve", "acknowledge"]


async def test_a_command_with_a_key_is_done_once_however_it_comes(tmp_path: Path) -> None:
    """By HTTP and by the bus, with another start between."""
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    again, notes = {"idempotency-key": '"a"'}, []
    command = Command(action="note", user="Kim", note="greased", key="a")
    for _ in range(2):
        async with served(config) as (service, client):
            answer = await done(client, PATH, NOTE, key="a")
            asked = COMMAND.encode("X", header(), command)
            told = await service.bus.ask(config.keys.key("X", OUTCOME), asked, PATIENCE_S)
            assert told is not None and OUTCOME.decode(told)[2].message == "greased (Kim)"
            assert answer.json() == {"outcome": "greased (Kim)"}
            other = await client.post(PATH, json=NOTE | {"note": "oiled"}, headers=again)
            assert other.status_code == 422
            assert "another command" in other.json()["detail"]
            found = (await client.get("api/v1/log?kind=note&kind=command")).json()["items"]
            notes.append([each["text"] for each in found])
    assert notes == [["greased (Kim)"]] * 2
