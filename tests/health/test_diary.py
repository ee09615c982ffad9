"""The diary: nothing is lost or doubled, and no kind of event pushes out another."""

import ast
from contextlib import closing

import pytest

from edge_service.health.events import kinds
from edge_service.health.events.diary import Diary
from edge_service.health.events.kinds import KINDS, is_chatter, room_of
from edge_service.health.events.old_journal import read_journal
from edge_service.nodes.supervision.task import TASK_EVENTS

from ..documents import ROOT
from .diaries import NS, START_NS, event, numbers

EVER = 2**62
DIARY_KINDS = sorted(kind for kind in KINDS if not is_chatter(kind))


def all_of(diary: Diary, axis: str = "X") -> list[int]:
    return numbers(diary.between(0, EVER, axis, 10**6))


@pytest.fixture(params=["on disk", "in memory"])
def diary(request, tmp_path):
    made = Diary(tmp_path / "diary.sqlite" if request.param == "on disk" else None)
    yield made
    made.close()


def test_ids_grow_within_a_burst_and_stay_exact_in_json(diary):
    ids = [each.id for each in diary.add([event(n) for n in range(5)], START_NS)]
    assert ids == sorted(set(ids))
    (later,) = diary.add([event(9)], START_NS + NS)
    assert ids[-1] < later.id < 2**53


def test_ids_grow_although_the_clock_goes_back_over_a_restart(tmp_path):
    path = tmp_path / "diary.sqlite"
    with closing(Diary(path)) as first:
        (before,) = first.add([event(0)], START_NS)
    with closing(Diary(path)) as second:
        (after,) = second.add([event(1)], START_NS - 3600 * NS)
        assert after.id > before.id
        assert all_of(second) == [0, 1]


def test_an_event_that_is_there_is_not_doubled(diary):
    (first,) = diary.add([event(0)], START_NS)
    again, other = diary.add([event(0), event(1)], START_NS + NS)
    assert (first.id, all_of(diary)) == (again.id, [0, 1])
    assert other.id > again.id


def test_two_processes_share_a_diary(tmp_path):
    path = tmp_path / "diary.sqlite"
    with closing(Diary(path)) as one, closing(Diary(path)) as two:
        (first,) = one.add([event(0)], START_NS)
        second, same = two.add([event(1), event(0)], START_NS)
        assert (same.id, all_of(one)) == (first.id, [0, 1])
        assert second.id != first.id


def test_events_are_found_by_axis_time_number_and_kind(diary):
    diary.add([event(n, axis=axis) for n, axis in enumerate(["X", "Y", "", "X"])], START_NS)
    assert all_of(diary) == [0, 2, 3]
    assert numbers(diary.between(START_NS + 1, START_NS + 3, "X", 10)) == [2]
    assert numbers(diary.between(0, EVER, "X", 2)) == [2, 3]
    first = diary.after(0, 1)
    assert numbers(first) == [0]
    assert numbers(diary.after(first[0].id, 2)) == [1, 2]
    diary.add([event(4, "part_replaced")], START_NS)
    assert diary.newest("X", "part_replaced").event == event(4, "part_replaced")
    assert diary.newest("Y", "part_replaced") is None


@pytest.mark.parametrize("kind", DIARY_KINDS)
def test_what_happens_all_the_time_pushes_out_nothing_else(kind, monkeypatch):
    sizes = {each: 200 if is_chatter(each) else 600 for each in KINDS}  # a 20th of it in memory
    monkeypatch.setattr(kinds, "KINDS", sizes)
    monkeypatch.setattr(kinds, "MOST_CHATTER", 200)
    diary = Diary()
    diary.add([event(0, kind), event(1, kind, "")], START_NS)
    for many in range(4):
        for chatter in ("status_changed", "component_changed", "data_fault", "a_new_one"):
            some = range(10 + many * 500, 510 + many * 500)
            diary.add([event(n, chatter, axis) for n in some for axis in ("X", "")], START_NS)
    assert [kind, kind] == [each.event.kind for each in diary.between(0, EVER, "X", 10**6)][:2]
    assert len(all_of(diary)) <= 2 + 2 * 4 * 510
    diary.close()


def test_a_reader_who_was_away_too_long_learns_it(monkeypatch):
    monkeypatch.setattr(kinds, "KINDS", {"note": 200, "alarm_raised": 200})
    with closing(Diary()) as diary:
        (first,) = diary.add([event(0, "alarm_raised")], START_NS)
        ids = [each.id for each in diary.add([event(n) for n in range(1, 601)], START_NS)]
        assert not diary.holds_all_after(first.id)
        assert diary.holds_all_after(ids[-11])
        assert all_of(diary) == [0, *range(591, 601)]


def test_every_kind_of_event_in_the_program_has_its_room():
    """A new kind needs a line in `kinds.py`: is it chatter, or does a person need it for years?"""
    found = set()
    for path in ROOT.glob("edge_service/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Event":
                if "outputs" in path.parts:  # said in a letter, never in the diary
                    continue
                kind = next(each.value for each in node.keywords if each.arg == "kind")
                found |= {each.value for each in ast.walk(kind) if isinstance(each, ast.Constant)}
    changes = ("raised", "cleared", "acknowledged", "shelved", "unshelved")
    alarms = {f"alarm_{change}" for change in changes}
    assert (found - {"alarm_"}) | alarms | set(TASK_EVENTS) <= set(KINDS)


def test_a_kind_that_nobody_knows_shares_a_room():
    assert room_of("invented") == room_of("another")
    assert room_of("note") != room_of("part_replaced")


def test_what_a_failing_disk_does_not_take_is_shown_and_written_later(tmp_path, caplog):
    path = tmp_path / "folder" / "diary.sqlite"
    path.parent.mkdir()
    with closing(Diary(path)) as diary:
        diary.add([event(0)], START_NS)
        diary._file.close()
        path.parent.rename(tmp_path / "gone")
        path.parent.write_text("in the way")
        ids = [each.id for n in (1, 2) for each in diary.add([event(n)], START_NS)]
        assert diary.problem
        assert diary.counters()["diary_unsaved"] == 2
        assert all_of(diary) == [1, 2]
        assert [each.id for each in diary.add([event(1)], START_NS)] == ids[:1]
        path.parent.unlink()
        (tmp_path / "gone").rename(path.parent)
        diary.care(0.0)
        assert not diary.problem
        assert diary.counters() == dict.fromkeys(diary.counters(), 0)
    with closing(Diary(path)) as again:
        assert all_of(again) == [0, 1, 2]
        assert [each.id for each in again.after(0, 9)][1:] == ids
    assert len([each for each in caplog.records if "cannot be kept" in each.message]) == 1


def test_what_waits_for_the_disk_is_bounded_and_chatter_goes_first(tmp_path, monkeypatch):
    from edge_service.health.events import diary as module

    monkeypatch.setattr(module, "_MOST_UNSAVED", 5)
    (tmp_path / "in the way").write_text("")
    with closing(Diary(tmp_path / "in the way" / "diary.sqlite")) as diary:
        diary.add([event(0), event(1)], START_NS)
        diary.add([event(n, "data_fault") for n in range(2, 9)], START_NS)
        assert all_of(diary) == [0, 1, 6, 7, 8]
        assert diary.counters()["diary_lost"] == 4


@pytest.mark.parametrize("value", ["{}", "[]", b"\xff\xfe", None, 1, 1.5, ""])
def test_a_damaged_entry_is_left_out_named_and_counted(value, tmp_path, caplog):
    path = tmp_path / "diary.sqlite"
    with closing(Diary(path)) as diary:
        ids = [each.id for each in diary.add([event(n) for n in range(3)], START_NS)]
        column = "digest" if value is None else "body"
        diary._file.rows(f"UPDATE events SET {column} = ? WHERE id = ?", value or "", ids[1])
        for _ in range(2):
            assert all_of(diary) == [0, 2]
        assert diary.counters()["diary_damaged_entries"] == 1
    assert [each.message for each in caplog.records] == [
        f"{path}: entry {ids[1]} is damaged and left out"
    ]


def test_a_journal_of_version_0_1_0_can_be_read(tmp_path):
    members = (
        '{"id": 7, "event": {"axis": "X", "kind": "note", "severity": "info", '
        '"message": "ge\\u00f6lt", "time_ns": 9, '
        '"data": {"user": "Kim", "none": null, "share": 0.5}}}'
    )
    path = tmp_path / "events.log"
    path.write_text(f"1b24b06e {members}\n1b24b06f {members}\nx\n")
    (known,) = read_journal(path)
    assert (known.id, known.event.message) == (7, "geölt")
    assert known.event.data == {"user": "Kim", "none": None, "share": 0.5}


def test_numbers_beyond_those_of_the_file_are_asked_for_without_harm(diary):
    diary.add([event(1)], START_NS)
    for far in (2**63, 10**30):
        assert diary.between(-far, far, "X", far) == diary.between(0, EVER, "X", 10)
        assert diary.after(far, 10) == ()
        assert diary.records(far, 10) == []
        assert diary.holds_all_after(far)


@pytest.mark.parametrize("year", [2100, 2262])
def test_events_that_a_wrong_clock_has_dated_after_now_block_nothing(year, diary, monkeypatch):
    monkeypatch.setitem(kinds.KINDS, "note", 60 * diary._shared)
    monkeypatch.setattr("edge_service.health.events.diary._PRUNE_EVERY", 1)
    wrong_ns = int((year - 1970) * 365.2425 * 86400) * NS
    diary.add([event(0)], START_NS)
    diary.add([event(n).model_copy(update={"time_ns": wrong_ns + n}) for n in (1, 2)], wrong_ns)
    after = diary.add([event(n) for n in range(3, 50)], START_NS + NS)
    ids = [each.id for each in diary.after(0, 1000)]
    assert ids == sorted(set(ids))
    assert ids[-1] == after[-1].id < 2**53
    assert diary.future(START_NS + NS) == 2
    assert diary.future(wrong_ns) == 0
    assert diary.future(0) == 0
    assert numbers(diary.between(0, START_NS + 60 * NS, "X", 1000)) == [0, *range(3, 50)]
    room = room_of("note")[1] // diary._shared
    later = [event(n) for n in range(50, room + 1)]
    diary.add(later, START_NS + 2 * NS)
    diary.add([event(room + 1)], START_NS + 3 * NS)
    assert diary.future(START_NS + NS) == 0
    assert len(all_of(diary)) == room
    assert all_of(diary)[-1] == room + 1
