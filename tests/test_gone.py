"""What is gone answers with one line that names what to do instead."""

import json
from pathlib import Path

import pytest

from edge_service.cli import entry
from edge_service.config import ConfigError, gone, load_config

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
    monkeypatch.setitem(gone.GONE, "axes.settings.ledger", "gone; leave it out")
    with pytest.raises(ConfigError, match=r"edge\.toml: axes\.settings\.ledger: gone; leave it"):
        load_config(path)
