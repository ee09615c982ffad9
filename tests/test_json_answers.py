"""Every answering command has `--json`, one typed document with units, and tells its progress."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock

import click
import numpy as np
import pytest
from pydantic import TypeAdapter

import edge_service.nodes.record_node as recording
from edge_service.cli.entry import cli, main
from edge_service.command_answer import Answer
from edge_service.config import DEFAULT_MACHINE
from edge_service.exit_status import BAD_INPUT, DONE

from .offline.test_servo_tuning import FREQUENCY, _response
from .recordings.tuning_files import tuning

WITHOUT = {
    "run": "serves until it is stopped",
    "node": "serves until it is stopped",
    "stub": "serves until it is stopped",
    "bench": "its options stand in a checkout alone, and --json among them",
    "help": "shows the help of another command",
    "version": "shows one word",
}
UNIT = re.compile(
    r"(^|_)(share|s|h|m|hz|rad|rpm|n|nm|mb|c|percent|rad_s2?|m_s2?|m_s3|kg|kg_m2|nm_s_per_rad|n_per_m|nm_per_rad)$"
)
PURE = {"probability", "level", "share", "energy_share", "sigmas", "relative", "n_effective"} | {
    *("log_evidence", "nut_share", "nut_share_sigma", "coverage", "nis", "tolerance", "height"),
    *("mode_probability", "fault_probability", "structure", "scores", "trend", "line", "context"),
    *("shrink", "replay", "speed", "p_value", "p_value_after", "noise", "force", "raceway_damage"),
    *("efficiency", "a", "b", "c", "z_numerator", "z_denominator", "magnitude", "step"),
}
"""Shares, probabilities and ratios: numbers without a unit; keys of the simulated drive, and of
linear models, whose units are those of their outputs over their inputs."""
BESIDE = {"unit", "x_label", "preload_percent"}
"""Keys that tell the unit of the numbers beside them."""
KNOWN = PURE | BESIDE
COMMANDS: dict[str, list[str]] = {
    "check-config": ["check-config"],
    "backup": ["backup", "{dir}/service.toml", "--out", "{dir}/again.zip"],
    "restore": ["restore", "{dir}/backup.zip", "{dir}/new/service.toml"],
    "token": ["token", "{dir}/service.toml"],
    "token --add": ["token", "{dir}/service.toml", "--add", "kim", "--role", "viewer"],
    "token --revoke": ["token", "{dir}/service.toml", "--revoke", "prometheus"],
    "replay": ["replay", "{trace}", "--speed", "0", "--port", "0"],
    "doctor": ["doctor", "{trace}"],
    "record": ["record", "--out", "{dir}/recorded.csv"],
    "convert": ["convert", "{trace}", "--out", "{dir}/trace.csv"],
    "simulate": ["simulate", "--duration", "3", "--out", "{dir}/s.csv"],
    "init": ["init", "modbus://127.0.0.1:9", "--out", "{dir}/edge.toml", "--machine", "{machine}"],
    "adopt": ["adopt", "{trace}", "--lead", "20", "--out", "{dir}/machine.toml"],
    "commission": ["commission", "{trace}", "--out", "{dir}/commissioned.toml"],
    "estimate": ["estimate", "{trace}", "--out", "{dir}/estimates.csv"],
    "motion": ["motion", "standstill", "--out", "{dir}/m.csv"],
    "motion without a name": ["motion"],
    "motion next": ["motion", "next", "--effect", "stribeck", "--effect", "backlash"],
    "motion isolability": ["motion", "isolability", "{monday}"],
    "fingerprint": ["fingerprint", "{trace}", "--out", "{dir}/fingerprint"],
    "fingerprint --baseline": [
        *("fingerprint", "{trace}", "--out", "{dir}/now"),
        *("--baseline", "{dir}/fingerprint.json"),
    ],
    "fingerprint of a tuning": ["fingerprint", "{tuning}", "--out", "{dir}/response"],
    "gap": ["gap", "{trace}"],
    "model": ["model"],
    "diagnose": ["diagnose", "{trace}", "--out", "{dir}/diagnosis"],
    "update": ["update", "{later}", "--out", "{dir}/updated.toml"],
    "check-diagnosis": ["check-diagnosis", "--plant", "own", "--effect", "delay", "--cases", "1"],
    "drift": ["drift", "{monday}", "{friday}"],
    "reproduce": ["reproduce", "wear", "{wear}", "--out", "{dir}/wear"],
    "fleet": ["fleet", "http://127.0.0.1:9"],
}
"""Each on the smallest input that it answers; a command with several answers more than once."""

QUICK = {"token", "token --revoke", "motion without a name", "model"}
"""Done before anybody wonders: they tell no progress."""


def has_json(command: click.Command) -> bool:
    return any("--json" in each.opts for each in command.params)


@pytest.mark.parametrize(("name", "command"), cli.commands.items())
def test_every_command_answers_as_json_or_says_why_not(name: str, command: click.Command) -> None:
    assert has_json(command) == (name not in WITHOUT)
    assert name in WITHOUT or name in COMMANDS


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Recordings and files that commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    paths = {
        "trace": folder / "acceleration.parquet",
        "monday": folder / "monday.parquet",
        "friday": folder / "friday.parquet",
        "later": folder / "later.parquet",
        "tuning": folder / "AST_AX1.xml",
        "wear": folder / "drag.txt",
    }
    motions = {"trace": "acceleration", "monday": "warmup", "friday": "warmup", "later": "warmup"}
    for seed, (name, motion) in enumerate(motions.items(), start=1):
        lasts = "50" if name == "later" else "20"
        seconds = ["--duration", lasts] if motion == "warmup" else []
        out = ["--seed", str(seed), "--out", str(paths[name])]
        assert main(["simulate", "--motion", motion, *seconds, *out]) == DONE
    paths["tuning"].write_text(tuning(FREQUENCY, _response(), np.full(300, 0.999), {}))
    paths["wear"].write_text("\n".join(f"{0.2 - 0.004 * k:.3f}" for k in range(16)))
    return {name: str(path) for name, path in paths.items()} | {"machine": str(DEFAULT_MACHINE)}


@pytest.fixture
def documents(monkeypatch: pytest.MonkeyPatch) -> list[type]:
    found: list[type] = []
    written = Answer.as_json

    def noted(answer: Answer) -> str:
        found.append(type(answer.document))
        return written(answer)

    monkeypatch.setattr(Answer, "as_json", noted)
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_the_answer_is_one_document_of_its_schema(
    name: str,
    inputs: dict[str, str],
    documents: list[type],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    prepare(name, inputs, tmp_path, monkeypatch)
    arguments = [part.format(dir=tmp_path, **inputs) for part in COMMANDS[name]]
    monkeypatch.setenv("EDGE_SERVICE_PROGRESS", "1")
    capfd.readouterr()
    assert main([*arguments, "--json"]) == DONE
    said, beside = capfd.readouterr()
    adapter = TypeAdapter(documents[0])
    assert adapter.dump_json(adapter.validate_json(said), by_alias=True).decode() == said.strip()
    assert list(without_unit(json.loads(said))) == []
    assert [line for line in beside.splitlines() if "loading" not in line] or name in QUICK


def prepare(
    name: str, inputs: dict[str, str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lay down what a command needs beside its recordings."""
    if name.startswith("token"):
        config = folder / "service.toml"
        config.write_text('store = { folder = "state" }\n[[axes]]\nname = "X"\n')
        assert main(["token", str(config), "--add", "prometheus", "--role", "viewer"]) == DONE
    if name in ("backup", "restore"):
        config = folder / "service.toml"
        config.write_text('[[axes]]\nname = "X"\n')
        assert main(["backup", str(config), "--out", str(folder / "backup.zip")]) == DONE
    if name == "fingerprint --baseline":
        assert main(["fingerprint", inputs["trace"], "--out", str(folder)]) == DONE
    if name == "record":
        monkeypatch.setattr(recording, "record_axis", AsyncMock(return_value=(1000, 0)))


def without_unit(node: Any, path: tuple[str, ...] = ()) -> Iterator[str]:
    """Numbers to which neither their names nor what stands beside them give a unit."""
    if isinstance(node, dict):
        named = (*path, str(node.get("name", "")), *(each for each in node if each in BESIDE))
        for key, value in node.items():
            yield from without_unit(value, (*named, key))
    elif isinstance(node, list):
        for value in node:
            yield from without_unit(value, path)
    elif isinstance(node, float) and not any(e in PURE | BESIDE or UNIT.search(e) for e in path):
        yield "/".join(path)


@pytest.mark.parametrize("name", [name for name, each in cli.commands.items() if has_json(each)])
def test_a_mistake_is_a_document_too(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([*name.split(), "--json", "--no-such-option"]) == BAD_INPUT
    told = capfd.readouterr()
    error = json.loads(told.out)["error"]
    assert error == {"detail": told.err.strip().removeprefix("edge-service: "), "exit_status": 2}
