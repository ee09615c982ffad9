"""The audit log: nothing removes an entry, and one that is missing or changed is seen."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

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
def test_what_is_missing_or_changed_is_seen(path, statement, wrong):
    attack(path, statement)
    assert [each.number for each in read_audit(path) if each.problem] == wrong
    with closing(Diary(path)) as diary:
        for first in (1, wrong[0]):
            found = diary.records(first, 100)
            assert [each.number for each in found if each.problem] == wrong


def test_events_never_push_out_an_entry(path):
    with closing(Diary(path)) as diary:
        for many in range(0, 3000, 500):
            diary.add([event(n, "data_fault") for n in range(many, many + 500)], START_NS)
        assert len(diary.records(1, 100)) == 5


def cut_off(path: Path, kept: int) -> None:
    """Put back a diary that ends after so many entries, as damage and its copy leave it."""
    path.unlink()
    path.with_name("@diary.head.json").unlink()
    with closing(Diary(path)) as diary:
        diary.add((), START_NS, [entry(number) for number in range(kept)])


@pytest.mark.parametrize("kept", [0, 1, 4])
def test_entries_cut_off_at_the_end_are_named_and_no_number_is_used_again(path, kept):
    head = path.with_name("@diary.head.json")
    whole = head.read_bytes()
    cut_off(path, kept)
    head.write_bytes(whole)
    for _ in range(2):
        with closing(Diary(path)) as diary:
            diary.care(1.0)
            diary.care(2.0)
            assert f"entries {kept + 1} to 5 are gone" in diary.audit_problem
            assert diary.entries == 6
    assert [each.number for each in read_audit(path)] == [*range(1, kept + 1), 6]


@pytest.mark.parametrize("content", [None, b"", b"[]", b'{"number": 5}'])
def test_without_a_head_a_rescued_log_says_that_its_end_may_be_gone(path, content):
    head = path.with_name("@diary.head.json")
    head.unlink() if content is None else head.write_bytes(content)
    path.write_bytes(path.read_bytes()[:4000])
    with closing(Diary(path)) as diary:
        diary.care(1.0)
        newest = diary.records(diary.entries, 1)[0]
        assert newest.problem == diary.audit_problem == "entries after 0 may be gone"
        assert sum(head.name in words for words in diary.damages) == (content is not None)


def test_a_head_that_is_behind_or_gone_is_written_anew_without_a_word(path):
    head = path.with_name("@diary.head.json")
    before = head.read_bytes()
    with closing(Diary(path)) as diary:
        diary.add((), START_NS, [entry(5)])
    after = head.read_bytes()
    for found in (before, None):
        head.unlink() if found is None else head.write_bytes(found)
        with closing(Diary(path)) as diary:
            diary.care(1.0)
            assert (diary.audit_problem, diary.damages) == ("", [])
        assert head.read_bytes() == after


def test_a_log_that_was_written_anew_as_a_whole_is_seen_by_its_head(path):
    head = path.with_name("@diary.head.json")
    whole = head.read_bytes()
    cut_off(path, 0)
    with closing(Diary(path)) as diary:
        diary.add((), START_NS, [entry(number + 10) for number in range(6)])
    head.write_bytes(whole)
    with closing(Diary(path)) as diary:
        diary.care(1.0)
        assert "entry 5 is not what was written" in diary.audit_problem
