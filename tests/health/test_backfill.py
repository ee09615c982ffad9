"""Catching up with the log of a machine: in order, none twice, and what is gone is said."""

from hypothesis import given
from hypothesis import strategies as st

from edge_service.health.fleet.backfill import caught, question_for
from edge_service.messages.fleet import Cursor, Hole
from edge_service.messages.plant import LogAnswer, LoggedReport, LogState, MachineReport


def answer(log: str, *numbers: int, machine: str = "m") -> LogAnswer:
    report = MachineReport(site="s", machine=machine, time_ns=0, version="1", axes=())
    return LogAnswer(
        log=log, reports=tuple(LoggedReport(number=each, report=report) for each in numbers)
    )


def log(first: int, last: int, name: str = "l") -> LogState:
    return LogState(log=name, first=first, last=last)


def at(number: int, name: str = "l") -> Cursor:
    return Cursor(log=name, number=number)


def test_a_log_is_asked_for_what_is_not_kept() -> None:
    def asked(state: LogState, cursor: Cursor | None) -> int | None:
        question = question_for(state, cursor)
        return None if question is None else question.after

    assert asked(log(1, 0), None) is None
    assert asked(log(1, 5), None) == 0
    assert asked(log(4, 5), None) == 3
    assert asked(log(1, 5), at(3)) == 3
    assert asked(log(1, 5), at(5)) is None
    assert asked(log(1, 5), at(9)) is None
    assert asked(log(8, 9), at(3)) == 7
    assert asked(log(1, 5), at(5, "another")) == 0
    assert asked(log(-7, 5), None) == 0


def test_what_the_log_lost_before_it_was_fetched_is_a_hole() -> None:
    more = caught(answer("l", 8, 9), log(8, 9), at(3), "s", "m")
    assert more is not None
    assert more.holes == (Hole(log="l", first=4, last=7),)
    assert more.cursor == at(9)
    more = caught(answer("l", 9, 11), log(8, 11), at(3), "s", "m")
    assert more is not None
    assert more.holes == (Hole(log="l", first=4, last=8), Hole(log="l", first=10, last=10))


def test_another_log_begins_without_a_hole() -> None:
    more = caught(answer("l", 1, 2), log(1, 2), at(77, "old"), "s", "m")
    assert more is not None
    assert more.holes == ()
    assert more.cursor == at(2)


def test_an_answer_that_cannot_be_believed_adds_nothing() -> None:
    state = log(1, 9)
    assert caught(answer("other", 1), state, None, "s", "m") is None
    assert caught(answer("l"), state, None, "s", "m") is None
    assert caught(answer("l", 3, 3), state, at(2), "s", "m") is None
    assert caught(answer("l", 4, 3), state, at(2), "s", "m") is None
    assert caught(answer("l", 2), state, at(2), "s", "m") is None
    assert caught(answer("l", 3, machine="other"), state, at(2), "s", "m") is None


@given(st.data())
def test_whatever_is_lost_on_the_way_every_number_is_kept_once_or_said_to_be_gone(data) -> None:
    """The log grows and loses its oldest between questions; some answers never come."""
    first, last, cursor = 1, data.draw(st.integers(0, 20)), None
    kept: list[int] = []
    gone: set[int] = set()
    began = None
    for _ in range(data.draw(st.integers(1, 12))):
        state = log(first, last)
        question = question_for(state, cursor)
        if question is not None and data.draw(st.booleans()):
            first = min(last, first + data.draw(st.integers(0, 3)))  # lost while it is asked
            most = data.draw(st.integers(1, 5))
            numbers = range(max(first, question.after + 1), last + 1)[:most]
            more = caught(answer("l", *numbers), state, cursor, "s", "m")
            if more is not None:
                began = question.after + 1 if began is None else began
                kept += [each.number for each in more.reports]
                gone |= {n for hole in more.holes for n in range(hole.first, hole.last + 1)}
                cursor = more.cursor
        last += data.draw(st.integers(0, 5))
        first = min(max(first, last - 12), last + 1)
    assert kept == sorted(set(kept))
    if cursor is not None and began is not None:
        assert set(kept) | gone == set(range(began, cursor.number + 1))
        assert not set(kept) & gone
