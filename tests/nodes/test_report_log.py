"""The log of reports: numbered without holes, bounded, another one after damage; its questions."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from pydantic import ValidationError

from edge_service.health.axis_report import axis_report
from edge_service.messages.health import AxisCondition
from edge_service.messages.plant import LogAnswer, LogQuestion, LogState, MachineReport
from edge_service.nodes.outputs.plant import log_keeper
from edge_service.nodes.outputs.plant.log_keeper import LogKeeper
from edge_service.nodes.outputs.plant.occasions import LOG_SPACING_S, Occasions
from edge_service.nodes.stores.report_log import FILE, MOST_ANSWER_BYTES, ReportLog
from edge_service.nodes.supervision.supervisor import Supervisor

from ..messages.answers import answer, health_of
from .conftest import heart, until

PLENTY = 100_000_000
KEY = "feeddrive/plant/v1/1/s/m/@log"


def report(number: int, axes: int = 1) -> MachineReport:
    return MachineReport(
        site="s",
        machine="m",
        time_ns=number,
        version="0.1",
        axes=(axis_report(answer()),) * axes,
    )


def asked(kept: ReportLog, after: int, most: int = 1000, log: str | None = None) -> LogAnswer:
    question = LogQuestion(log=log or kept.state().log, after=after, most=most)
    return LogAnswer.model_validate_json(kept.answer(question), strict=True)


def test_reports_come_back_in_order_with_their_numbers_also_after_a_restart(tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    empty = kept.state()
    assert (empty.first, empty.last) == (1, 0)
    for number in range(1, 41):
        assert kept.append(report(number)) == LogState(log=empty.log, first=1, last=number)
    kept.close()
    again = ReportLog(tmp_path / FILE, PLENTY)
    again.append(report(41))
    told = asked(again, 0)
    assert told.log == empty.log
    assert [each.number for each in told.reports] == list(range(1, 42))
    assert [each.report for each in told.reports] == [report(n) for n in range(1, 42)]
    assert [each.number for each in asked(again, 17, 3).reports] == [18, 19, 20]
    assert asked(again, 41).reports == ()
    again.close()


def test_the_oldest_make_room_and_the_numbers_go_on(tmp_path: Path) -> None:
    size = len(report(1).model_dump_json()) + 50
    kept = ReportLog(tmp_path / FILE, 10 * size + 20)
    for number in range(1, 100):
        state = kept.append(report(number))
        assert (state.first, state.last) == (max(1, number - 9), number)
    kept.close()
    again = ReportLog(tmp_path / FILE, 3 * size + 20)
    state = again.append(report(100))
    assert (state.first, state.last) == (98, 100)
    assert [each.number for each in asked(again, 0).reports] == [98, 99, 100]
    again.close()


def test_one_report_is_kept_however_small_the_log(tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, 1)
    kept.append(report(1))
    assert [each.number for each in asked(kept, 0).reports] == [1]
    kept.close()


def test_an_answer_is_bounded_and_the_next_question_goes_on(tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    for number in range(1, 9):
        kept.append(report(number, axes=600))
    found: list[int] = []
    while len(found) < 8:
        said = kept.answer(LogQuestion(log=kept.state().log, after=max(found, default=0), most=9))
        assert len(said) < MOST_ANSWER_BYTES + 10_000
        found += [each["number"] for each in json.loads(said)["reports"]]
    assert found == list(range(1, 9))
    kept.close()


def test_of_another_log_there_is_no_report_but_the_name_of_this_one(tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    state = kept.append(report(1))
    assert asked(kept, 0, log="another") == LogAnswer(log=state.log, reports=())
    kept.close()


def destroyed(path: Path) -> None:
    path.write_bytes(b"no database" * 1000)


def removed(path: Path) -> None:
    for part in path.parent.glob(f"{path.name}*"):
        part.unlink()


@pytest.mark.parametrize("damage", [destroyed, removed])
def test_a_log_that_is_damaged_or_gone_is_another_one(
    damage: Callable[[Path], None], tmp_path: Path
) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    before = kept.append(report(1))
    kept.close()
    damage(tmp_path / FILE)
    after = kept.append(report(2))
    assert after.log != before.log
    assert (after.first, after.last) == (1, 1)
    assert len(kept.news) == 1
    assert FILE in kept.news[0]
    kept.append(report(3))
    assert len(kept.news) == 1
    assert [each.report.time_ns for each in asked(kept, 0).reports] == [2, 3]
    kept.close()


def test_a_report_with_a_changed_byte_is_left_out_and_counted(tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    for number in range(1, 4):
        kept.append(report(number))
    kept.close()
    with closing(sqlite3.connect(tmp_path / FILE)) as file:
        (content,) = file.execute("SELECT content FROM reports WHERE number = 2").fetchone()
        changed = content.replace(b'"time_ns":2', b'"time_ns":9', 1)
        file.execute("UPDATE reports SET content = ? WHERE number = 2", (changed,))
        file.commit()
    assert [each.number for each in asked(kept, 0).reports] == [1, 3]
    assert kept.damaged == 1
    kept.close()


# the keeper, and what is asked of it

GOOD = {"log": "x", "after": 0, "most": 10}
HOSTILE = {
    "garbage": b"\xff\xfe no text",
    "no object": b"[1, 2]",
    "deep": b'{"log": ' + b"[" * 5000 + b"]" * 5000 + b"}",
    "nothing": b"",
    "missing": b'{"log": "x", "after": 0}',
    "negative after": json.dumps(GOOD | {"after": -1}).encode(),
    "most of a billion": json.dumps(GOOD | {"most": 10**9}).encode(),
    "most of none": json.dumps(GOOD | {"most": 0}).encode(),
    "after beyond all": json.dumps(GOOD | {"after": 2**63}).encode(),
    "digits": b'{"log": "x", "most": 1, "after": ' + b"9" * 5000 + b"}",
    "not a number": b'{"log": "x", "most": 1, "after": NaN}',
    "long name": json.dumps(GOOD | {"log": "x" * 65}).encode(),
}


@pytest.mark.parametrize("name", HOSTILE)
async def test_a_question_that_cannot_be_meant_gets_no_answer(name: str, tmp_path: Path) -> None:
    kept = ReportLog(tmp_path / FILE, PLENTY)
    keeper, replies = LogKeeper(kept, KEY, print), list[bytes | None]()
    keeper.ask(KEY, HOSTILE[name], replies.append)
    assert replies == [None]
    assert keeper.counters()["log_refused"] == 1
    keeper.ask(f"{KEY}/more", json.dumps(GOOD).encode(), replies.append)
    assert replies == [None, None]


def test_questions_are_checked_where_they_are_made_too() -> None:
    with pytest.raises(ValidationError):
        LogQuestion(log="x", after=-1, most=1)


async def test_without_a_log_nothing_is_kept_and_every_question_refused() -> None:
    keeper, replies = LogKeeper(None, KEY, print), list[bytes | None]()
    keeper.put(report(1))
    keeper.ask(KEY, json.dumps(GOOD).encode(), replies.append)
    await keeper.run(heart())
    assert (replies, keeper.state) == ([None], None)


async def test_what_a_failing_disk_does_not_take_is_kept_and_bounded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_keeper, "MOST_WAITING", 20)
    place = tmp_path / "no folder"
    place.write_text("a file")
    keeper = LogKeeper(ReportLog(place / FILE, PLENTY), KEY, print)
    supervisor = Supervisor()
    tasks = supervisor.tasks("test")
    replies: list[bytes | None] = []
    tasks.start("log", keeper.run)

    async def has_failed() -> bool:
        return bool(keeper.problem)

    await until(has_failed)
    keeper.ask(KEY, json.dumps(GOOD).encode(), replies.append)
    for number in range(27):
        keeper.put(report(number))
    assert keeper.counters()["log_dropped"] == 7
    place.unlink()

    async def is_answered() -> bool:
        return bool(replies)

    await until(is_answered)
    assert keeper.problem == ""
    assert keeper.state is not None and keeper.state.last == 20
    await tasks.end()
    kept = ReportLog(place / FILE, PLENTY)
    first = asked(kept, 0, 3)
    assert [(each.number, each.report.time_ns) for each in first.reports] == [
        (1, 7),
        (2, 8),
        (3, 9),
    ]
    kept.close()
    assert replies == [f'{{"log": "{first.log}", "reports": []}}'.encode()]
    await keeper.close(heart())


# occasions


def axes(condition: AxisCondition) -> tuple:
    return (axis_report(answer(health=health_of(condition))),)


GOOD_AXES, BAD_AXES = axes(AxisCondition.NORMAL), axes(AxisCondition.FAULT)


def test_a_report_goes_out_in_each_period_and_at_once_on_a_change() -> None:
    occasions = Occasions(1.0, 600.0)
    assert occasions.to_publish(GOOD_AXES, 0.0)
    assert not occasions.to_publish(GOOD_AXES, 0.5)
    assert occasions.to_publish(BAD_AXES, 0.75)
    assert not occasions.to_publish(BAD_AXES, 1.0)
    assert occasions.to_publish(BAD_AXES, 1.75)


def test_changes_are_logged_but_one_to_and_fro_does_not_fill_the_log() -> None:
    occasions = Occasions(1.0, 600.0)
    assert occasions.to_log(GOOD_AXES, 0.0)
    assert not occasions.to_log(GOOD_AXES, 599.0)
    assert occasions.to_log(GOOD_AXES, 600.0)
    assert not occasions.to_log(BAD_AXES, 600.0 + LOG_SPACING_S / 2)
    assert not occasions.to_log(GOOD_AXES, 600.0 + LOG_SPACING_S)
    assert occasions.to_log(BAD_AXES, 600.5 + LOG_SPACING_S)
    assert not occasions.to_log(BAD_AXES, 700.0)
