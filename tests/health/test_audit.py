"""The audit log: nothing removes an entry, and one that is missing or changed is seen."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.health.events.audit import AuditEntry, read_audit
from edge_service.health.events.diary import Diary
from edge_service.nodes.stores.diary_store import DIARY

from .diaries import START_NS, event


def entry(number: int) -> AuditEntry:
    return AuditEntry(
        time_ns=START_NS + number, who="Kim", origin="127.0.0.1", action=f"action {number}"
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A diary with five entries."""
    path = tmp_path / DIARY
    with closing(Diary(path)) as diary:
        for number in range(5):
            diary.add((), START_NS, [entry(number)])
    return path


def attack(path: Path, statement: str) -> None:
    """Change the file as somebody with the service's rights could."""
    with closing(sqlite3.connect(path)) as file:
        for trigger in ("changed", "shortened"):
            file.execute(f"DROP TRIGGER audit_is_not_{trigger}")
        file.execute(statement)
        file.commit()


def test_entries_are_numbered_and_an_entry_is_not_doubled(path):
    with closing(Diary(path)) as diary:
        diary.add((), START_NS, [entry(4), entry(5)])
        assert diary.entries == 6
        found = diary.records(1, 100)
        assert [each.entry.action for each in found] == [f"action {n}" for n in range(6)]
        assert [each.number for each in diary.records(3, 2)] == [3, 4]
        assert not any(each.problem for each in (*found, *diary.records(3, 2)))


@pytest.mark.parametrize("statement", ["DELETE FROM audit", "UPDATE audit SET body = ''"])
def test_the_file_itself_refuses_changes(path, statement):
    with closing(sqlite3.connect(path)) as file, pytest.raises(sqlite3.IntegrityError):
        file.execute(statement)


@pytest.mark.parametrize(
    ("statement", "wrong"),
    [
        ("DELETE FROM audit WHERE number = 3", [4]),
        ("DELETE FROM audit WHERE number = 1", [2]),
        ("UPDATE audit SET body = replace(body, 'Kim', 'Lee') WHERE number = 2", [2]),
        ("UPDATE audit SET body = '[]' WHERE number = 5", [5]),
        ("UPDATE audit SET body = x'ff00' WHERE number = 5", [5]),
        ("UPDATE audit SET chain = '' WHERE number = 2", [2, 3]),
        ("UPDATE audit SET number = 9 WHERE number = 5", [9]),
    ],
)
def test_what_is_missing_or_changed_is_seen(path, statement, wrong, capsys):
    attack(path, statement)
    assert [each.number for each in read_audit(path) if each.problem] == wrong
    with closing(Diary(path)) as diary:
        for first in (1, wrong[0]):
            found = diary.records(first, 100)
            assert [each.number for each in found if each.problem] == wrong
    assert main(["audit", str(path.parent)]) == 1
    assert f"cannot be trusted: {wrong[0]}" in capsys.readouterr().err


def test_events_never_push_out_an_entry(path):
    with closing(Diary(path)) as diary:
        for many in range(0, 3000, 500):
            diary.add([event(n, "data_fault") for n in range(many, many + 500)], START_NS)
        assert len(diary.records(1, 100)) == 5


def test_the_command_prints_the_log_and_says_what_it_cannot_read(path, capsys, tmp_path):
    assert main(["audit", str(path.parent)]) == 0
    assert '"action": "action 0"' in capsys.readouterr().out.splitlines()[0]
    assert main(["audit", str(tmp_path / "none")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
