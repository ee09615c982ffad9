"""A running service with a marker in every secret shows it nowhere: logs, answers, the bus."""

import json
import logging
import re
import tomllib
from pathlib import Path
from typing import Any

import httpx
import pytest
from click.testing import CliRunner

from drivers.registry import driver_names
from edge_service.cli.entry import cli
from edge_service.config import load_config

from ..documents import ROOT
from ..drivers.bench import free_port
from ..test_secrets import KEYS, MARKER
from .conftest import done, running, until
from .receivers import MISBEHAVING, receiving

NODES: tuple[str, ...] = ("mqtt", "http", "health", "estimate", "downsample", "acquire")
SAMPLES = {
    "axis": "X",
    "form": "parquet",
    "number": "1",
    "name": "a.csv",
    "output": "webhook",
    "letter": "1",
}

HAS_MQTT = "mqtt" in driver_names()
MQTT_AXIS = """
[[axes]]
name = "Y"
driver = "mqtt"
[axes.settings]
host = "127.0.0.1"
port = {port}
topic = "a"
user = "edge"
password = "{marker}"
"""


def configuration(hook: int) -> tuple[str, set[tuple[str, str]]]:
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
[mqtt]
host = "127.0.0.1"
port = {free_port()}
user = "edge"
password = "{MARKER}"
[email]
host = "127.0.0.1"
port = {free_port()}
user = "edge"
password = "{MARKER}"
sender = "edge@example.org"
recipients = ["shift@example.org"]
kinds = ["note"]
severities = ["info"]
gather_s = 0.0
[webhook]
url = "http://user:{MARKER}@127.0.0.1:{hook}/{MARKER}?key={MARKER}"
secret = "{MARKER}"
previous_secret = "{MARKER}"
kinds = ["note"]
give_up_h = 1e-4
[[axes]]
name = "X"
driver = "opcua"
[axes.settings]
"""
        + "\n".join(lines)
        + (MQTT_AXIS.format(port=free_port(), marker=MARKER) if HAS_MQTT else "")
    )
    held = {("mqtt", "password"), ("email", "password")}
    held |= {("webhook", key) for key in ("url", "secret", "previous_secret")}
    drivers = {"driver opcua", *(["driver mqtt"] if HAS_MQTT else [])}
    return text, held | {(driver, "password") for driver in drivers}


async def answers(address: str) -> dict[str, str]:
    """Answer of every route that reads, by its path."""
    told = {}
    async with httpx.AsyncClient(base_url=address, timeout=20.0) as client:
        paths = (await client.get("/openapi.json")).json()["paths"]
        reading = [path for path, methods in paths.items() if "get" in methods]
        for path in ("/", "/openapi.json", *reading):
            if path != "/api/v1/events":  # never ends; what it tells stands elsewhere, too
                filled = re.sub(r"\{(\w+)\}", lambda match: SAMPLES[match[1]], path)
                told[path] = (await client.get(filled)).text
    return told


async def test_no_secret_is_in_a_log_an_answer_or_on_the_bus(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    heard: list[bytes] = []

    async with receiving() as receiver:
        receiver.manner = MISBEHAVING["garbage"]
        text, held = configuration(receiver.port)
        assert held == {(where, key) for where, _, key in KEYS}, "a new secret: give it a marker"
        path = tmp_path / "edge.toml"
        path.write_text(text)
        path.chmod(0o600)

        async with running(load_config(path), NODES) as service:
            address = await service.address
            subscriber = service.bus._session.declare_subscriber(
                "**", lambda sample: heard.append(sample.payload.to_bytes())
            )

            async def complained() -> bool:
                said = caplog.text
                lost = ("lost: opc.tcp", *(["lost: 127.0.0.1"] if HAS_MQTT else []))
                return all(
                    name in said for name in ("webhook: http:", "mqtt: ", "email: 127", *lost)
                )

            async def dead_letter() -> Any:
                async with httpx.AsyncClient(base_url=address) as client:
                    outputs = (await client.get("/api/v1/outputs")).json()["outputs"]
                return [letter for each in outputs for letter in each["dead_letters"]]

            note = {"action": "note", "user": "kim", "note": "a word"}
            async with httpx.AsyncClient(base_url=address) as client:
                await done(client, "/api/v1/axes/X/commands", note, key="a")
            await until(complained)
            assert await until(dead_letter)
            told = await answers(address)
            receiver.manner = None
            async with httpx.AsyncClient(base_url=address) as client:
                answer = await client.post("/api/v1/outputs/webhook/dead")
                assert answer.status_code == 202

            async def arrived() -> bool:
                return bool(receiver.taken)

            await until(arrived)
            subscriber.undeclare()
        assert receiver.heads
    assert heard
    shown = told | {"log": caplog.text, "bus": b"\n".join(heard).decode("latin-1")}
    assert [where for where, words in shown.items() if MARKER in words] == []
    assert "edge_service_component_counts_total" in told["/metrics"]


def test_no_secret_is_in_what_check_config_prints(tmp_path: Path) -> None:
    text, _ = configuration(free_port())
    path = tmp_path / "edge.toml"
    path.write_text(text)
    result = CliRunner().invoke(cli, ["check-config", str(path)])
    assert "configuration is right" in result.output
    assert MARKER not in result.output
