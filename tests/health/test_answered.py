"""Commands that come again with their key."""

import pytest

from edge_service.health.axis_monitor import MOST_ANSWERED, AnsweredCommands
from edge_service.messages.command import Command, Outcome

DONE = Outcome(accepted=True, message="done")


def note(key: str, **members: object) -> Command:
    return Command.model_validate({"action": "note", "user": "Kim", "key": key} | members)


def test_a_command_without_a_key_is_new_each_time() -> None:
    known = AnsweredCommands()
    known.note(note(""), DONE)
    assert known.outcome(note("")) is None


@pytest.mark.parametrize("outcome", [DONE, Outcome(accepted=False, message="nothing to do")])
def test_the_same_command_has_the_same_outcome_wherever_it_comes_from(outcome: Outcome) -> None:
    known = AnsweredCommands()
    known.note(note("a"), outcome)
    assert known.outcome(note("a", origin="192.0.2.1")) == outcome
    assert known.outcome(note("b")) is None


CHANGES = {
    "note": "x",
    "user": "Lee",
    "action": "part_replaced",
    "duration_s": 1.0,
    "occurrence": 3,
}


@pytest.mark.parametrize("member", CHANGES)
def test_another_command_with_the_key_is_refused(member: str) -> None:
    known = AnsweredCommands()
    known.note(note("a"), DONE)
    other = known.outcome(note("a", **{member: CHANGES[member]}))
    assert other is not None
    assert (other.accepted, other.reused) == (False, True)


def test_every_member_of_a_command_is_compared_or_known_not_to_matter() -> None:
    assert set(Command.model_fields) == {*CHANGES, "alarm", "key", "origin"}


def test_the_oldest_make_room_and_the_rest_outlives_the_process() -> None:
    known = AnsweredCommands()
    for number in range(2 * MOST_ANSWERED):
        known.note(note(str(number)), DONE)
    after = AnsweredCommands()
    after.restore(known.snapshot())
    found = [after.outcome(note(str(number))) for number in range(2 * MOST_ANSWERED)]
    assert found == [None] * MOST_ANSWERED + [DONE] * MOST_ANSWERED
