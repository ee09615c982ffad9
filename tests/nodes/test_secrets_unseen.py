"""A running service with a marker in every secret shows it nowhere: logs, answers, the bus."""

import json
import logging
import re
import tomllib
from pathlib import Path

import httpx
import pytest
import zenoh
from click.testing import CliRunner

from drivers.base import driver_names
from edge_service.bus.settings import BusSettings, zenoh_config
from edge_service.cli.entry import cli
from edge_service.config import load_config
from edge_service.outputs.notify import NotifyOutput

from ..documents import ROOT
from ..drivers.bench import free_port
from ..outputs.notify.receiver import Receiver
from ..test_secrets import KEYS, MARKER
from .conftest import served, until

NODES: tuple[str, ...] = ("mqtt", "notify", "http", "health", "estimate", "downsample", "acquire")
SAMPLES = {"axis": "X", "name": "a.csv", "output": "notify"}
HAS_MQTT = "mqtt" in driver_names()
MQTT_AXIS = """
[[axes]]
name = "Y"
driver = "mqtt"
[axes.settings]
url = "mqtt://edge@127.0.0.1:{port}"
topic = "a"
password = "{marker}"
"""


def configuration(folder: Path, hook: int) -> tuple[str, set[tuple[str, str]]]:
    """A configuration with the marker in every secret, and the keys that hold it."""
    opcua = tomllib.loads((ROOT / "deploy" / "drivers" / "opcua.toml").read_text())
    settings = opcua["axes"][0]["settings"] | {
        "url": f"opc.tcp://127.0.0.1:{free_port()}",
        "user": "operator",
        "password": MARKER,
    }
    lines = [f"{key} = {json.dumps(value)}" for key, value in settings.items() if key != "signals"]
    for signal in settings["signals"]:
        lines += ["[[axes.settings.signals]]"]
        lines += [f"{key} = {json.dumps(value)}" for key, value in signal.items()]
    text = (
        f"""\
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
[outputs.mqtt]
url = "mqtt://edge@127.0.0.1:{free_port()}"
password = "{MARKER}"
[outputs.notify]
urls_file = "notify.urls"
events = ["note"]
level = "NORMAL"
[[axes]]
name = "X"
driver = "opcua"
[axes.settings]
"""
        + "\n".join(lines)
        + (MQTT_AXIS.format(port=free_port(), marker=MARKER) if HAS_MQTT else "")
    )
    urls = folder / "notify.urls"
    urls.write_text(f"json://user:{MARKER}@127.0.0.1:{hook}/{MARKER}?rto=2&cto=2\n")
    urls.chmod(0o600)
    held = {("outputs.mqtt", "password")}
    drivers = {"driver opcua", *(["driver mqtt"] if HAS_MQTT else [])}
    return text, held | {(driver, "password") for driver in drivers}


async def answers(client: httpx.AsyncClient) -> dict[str, str]:
    """Answer of every route that reads, by its path."""
    told = {}
    paths = (await client.get("/openapi.json")).json()["paths"]
    reading = [path for path, methods in paths.items() if "get" in methods]
    for path in ("/", "/openapi.json", *reading):
        if path != "/api/v1/events":  # never ends; what it tells stands elsewhere, too
            filled = re.sub(r"\{(\w+)\}", lambda match: SAMPLES.get(match[1], "1"), path)
            told[path] = (await client.get(filled)).text
    return told


async def test_no_secret_is_in_a_log_an_answer_or_on_the_bus(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.DEBUG)
    heard: list[bytes] = []

    monkeypatch.setattr(NotifyOutput, "gather_s", 0.0)
    receiver = Receiver(free_port(), status=403)
    await receiver.start()
    text, held = configuration(tmp_path, receiver.port)
    assert held == {(where, key) for where, _, key in KEYS}, "a new secret: give it a marker"
    path = tmp_path / "edge.toml"
    path.write_text(text)
    path.chmod(0o600)
    async with served(load_config(path), NODES) as (service, client):
        foreign = zenoh.open(zenoh_config(BusSettings(service.bus.endpoint, "client")))
        foreign.declare_subscriber("**", lambda sample: heard.append(sample.payload.to_bytes()))
        lost = ("acquire: opc.tcp", *(["acquire: 127.0.0.1"] if HAS_MQTT else []))

        async def sent() -> bool:
            note = {"action": "note", "user": "kim", "note": "a word"}
            answer = await client.post("/api/v1/axes/X/commands", json=note)
            return answer.status_code == 202

        await until(sent)
        for words in ("mqtt: 127", "a dead letter", *lost):
            await until(lambda words=words: words in caplog.text)
        told = await answers(client)
        receiver.status = 200
        answer = await client.post("/api/v1/outputs/notify", json={"action": "requeue"})
        assert answer.status_code == 204
        await until(lambda: receiver.taken)
        foreign.close()
    await receiver.stop()
    assert heard
    shown = told | {"log": caplog.text, "bus": b"\n".join(heard).decode("latin-1")}
    assert [where for where, words in shown.items() if MARKER in words] == []


def test_no_secret_is_in_what_check_config_prints(tmp_path: Path) -> None:
    text, _ = configuration(tmp_path, free_port())
    path = tmp_path / "edge.toml"
    path.write_text(text)
    path.chmod(0o600)
    result = CliRunner().invoke(cli, ["check-config", str(path)])
    assert "configuration is right" in result.output
    assert MARKER not in result.output
