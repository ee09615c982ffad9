"""Rights that are changed from the command line stand in the audit log, if that is named."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.health.events.audit import AuditEntry, read_audit
from edge_service.health.events.diary import Diary
from edge_service.http_api.security import tokens
from edge_service.nodes.stores.diary_store import DIARY

Command = Callable[[Path], list[str]]
COMMANDS: dict[str, Command] = {
    "add_token": lambda p: ["token", "add", "Kim", "--role", "admin", "--file", str(p / "t.json")],
    "revoke_token": lambda p: ["token", "revoke", "screen", "--file", str(p / "t.json")],
    "make_certificates": lambda p: ["certs", "--out", str(p / "certificates")],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    history = tmp_path / "history"
    history.mkdir()
    with closing(Diary(history / DIARY)) as diary:
        diary.care(1e9)
    add = ["token", "add", "screen", "--role", "viewer", "--file", str(tmp_path / "t.json")]
    assert main(add) == 0
    return history


def entries(folder: Path) -> list[AuditEntry]:
    records = read_audit(folder / DIARY)
    assert not any(record.problem for record in records)
    return [record.entry for record in records if record.entry]


def state(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("action", COMMANDS)
def test_intent_and_outcome_are_noted(action: str, folder: Path, tmp_path: Path) -> None:
    assert main([*COMMANDS[action](tmp_path), "--history", str(folder)]) == 0
    before, after = entries(folder)
    assert (before.action, before.outcome) == (action, "begun")
    assert (after.action, after.outcome, after.origin) == (action, "done", "command line")
    assert after.who
    assert after.data == before.data


@pytest.mark.parametrize("action", COMMANDS)
def test_without_an_audit_log_it_is_said(
    action: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(COMMANDS[action](tmp_path)) == 0
    assert "this stands in no audit log" in capsys.readouterr().err
    assert entries(folder) == []


@pytest.mark.parametrize("action", COMMANDS)
def test_where_it_cannot_be_noted_nothing_is_changed(
    action: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = state(tmp_path)
    assert main([*COMMANDS[action](tmp_path), "--history", str(tmp_path / "other")]) == 2
    assert "there is no audit log" in capsys.readouterr().err
    assert state(tmp_path) == before


def test_what_fails_is_noted_as_refused(folder: Path, tmp_path: Path) -> None:
    command = ["token", "revoke", "nobody", "--file", str(tmp_path / "t.json")]
    assert main([*command, "--history", str(folder)]) == 2
    assert entries(folder)[-1].outcome.startswith("refused: ")


def test_a_crash_leaves_an_intent_without_outcome(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def dies(*_args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tokens, "add_token", dies)
    assert main([*COMMANDS["add_token"](tmp_path), "--history", str(folder)]) == 130
    assert [each.outcome for each in entries(folder)] == ["begun"]
