"""`check-config` tells every mistake and what is gone, and what a right configuration means."""

import json
from pathlib import Path

import pytest

from edge_service.cli import entry
from edge_service.cli.entry import main
from edge_service.config import ConfigError, EdgeConfig, load_config, load_machine, mistakes

WRONG = """
[http]
prot = 1
port = "x"
[health]
warning_percent_of_fresh = 3
[outputs.mqt]
[[axes]]
name = "X"
machine = "nowhere.toml"
[[axes]]
name = "Y"
driver = "modbus"
settings = { url = "modbus://mill", poll_groups = { fast = 0.02 }, register = [] }
"""
TOLD = (
    "health.warning_percent_of_fresh: now alarms.warning_percent",
    "http.port: Input should be a valid integer, unable to parse string as an integer (got 'x')",
    "http.prot: unknown key; did you mean http.port?",
    "nowhere.toml: no such file",
    "axes.Y.settings.registers: missing",
    "axes.Y.settings.register: unknown key; did you mean registers?",
    "outputs.mqt: no output 'mqt' is installed; there are metrics, mqtt, mtconnect, notify, opcua",
)


def written(folder: Path, text: str) -> Path:
    path = folder / "edge.toml"
    path.write_text(text)
    return path


def test_every_mistake_is_a_line_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, WRONG)
    assert main(["check-config", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(TOLD)
    for said in TOLD:
        assert [line for line in lines if line.endswith(f"/{said}") or line.endswith(f": {said}")]


def test_other_commands_tell_the_first_and_how_many(tmp_path: Path) -> None:
    path = written(tmp_path, WRONG)
    with pytest.raises(ConfigError) as told:
        load_config(path)
    assert str(told.value) == f"{path}: {TOLD[0]} (and 2 more: `edge-service check-config {path}`)"


def test_a_file_of_the_other_kind_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, '[[axes]]\nname = "X"\nmachine = "m.toml"\n')
    (tmp_path / "m.toml").write_text("[axis]\nlead_m = 0.01\n[model]\ninertia_kg_m2 = 1e-3\n")
    with pytest.raises(ConfigError, match=r"expected a machine file; that of axis X is m\.toml$"):
        load_machine(path)
    with pytest.raises(ConfigError, match=r"this is a machine file \(\[axis\], \[model\]\)"):
        load_config(tmp_path / "m.toml")


def test_effective_values_hide_secrets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = '[outputs.mqtt]\nurl = "mqtt://u@127.0.0.1"\npassword = "hidden-part"\n'
    path = written(tmp_path, f'{table}[[axes]]\nname = "X"\n')
    path.chmod(0o600)
    assert main(["check-config", str(path), "--json"]) == 0
    said = capsys.readouterr().out
    effective = json.loads(said)["effective"]
    assert effective["outputs"]["mqtt"]["password"] == "***"
    assert effective["axes"][0]["settings"]["rate_hz"] == 1000.0
    assert "hidden-part" not in said


def test_limits_of_an_axis_take_precedence() -> None:
    axes = [{"name": "X", "warning_percent": 50.0}, {"name": "Y"}]
    config = EdgeConfig.model_validate({"alarms": {"fault_percent": 20.0}, "axes": axes})
    assert config.limits_percent("X") == (50.0, 20.0)
    assert config.limits_percent("Y") == (60.0, 20.0)
    with pytest.raises(ValueError, match="fault_percent must lie below warning_percent"):
        EdgeConfig.model_validate({"axes": [{"name": "X", "warning_percent": 25.0}]})


CALLS = [
    (["weigh", "x.toml"], "weigh"),
    (["run", "--frob=1"], "run --frob"),
    (["token", "list"], "token list"),
    (["gap", "t.csv", "--crew", "3"], "--crew"),
]


@pytest.mark.parametrize(("arguments", "key"), CALLS)
def test_a_gone_command_or_option_is_one_line_and_status_2(
    arguments: list[str],
    key: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(entry.GONE, key, "now gap")
    assert entry.main([*arguments, "--json"]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"edge-service: {key}: now gap\n"
    assert json.loads(captured.out)["error"]["detail"] == f"{key}: now gap"


def test_nothing_that_is_gone_is_still_there() -> None:
    there = set(entry.cli.commands)
    for name, command in entry.cli.commands.items():
        options = {option for parameter in command.params for option in parameter.opts}
        there |= options | {f"{name} {option}" for option in options}
    assert not there & set(entry.GONE)


def test_a_gone_key_names_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "edge.toml"
    path.write_text('[[axes]]\nname = "X"\n[axes.settings]\nledger = 1\n')
    monkeypatch.setitem(mistakes.GONE, "axes.settings.ledger", "gone; leave it out")
    with pytest.raises(ConfigError, match=r"edge\.toml: axes\.settings\.ledger: gone; leave it"):
        load_config(path)
