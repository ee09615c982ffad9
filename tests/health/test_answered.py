"""Commands that come again with their key."""

import math

import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.axis_monitor import MOST_ANSWERED, AxisMonitor
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.health import Command, Outcome

NOW_NS = 1_795_000_000 * 10**9


def monitor() -> AxisMonitor:
    return AxisMonitor("X", 7.0, ScrewGeometry(0.01 / math.pi, 0.8), AlarmsConfig(), NOW_NS)


def note(key: str, **members: object) -> Command:
    asked = {"action": "note", "user": "Kim", "note": "greased", "key": key} | members
    return Command.model_validate(asked)


def test_a_command_without_a_key_is_new_each_time() -> None:
    known = monitor()
    known.obey(note(""), NOW_NS)
    assert known.answered(note("")) is None


@pytest.mark.parametrize("asked", [{}, {"action": "acknowledge", "alarm": "rate"}])
def test_the_same_command_has_the_same_outcome_wherever_it_comes_from(asked: dict) -> None:
    known = monitor()
    outcome, _ = known.obey(note("a", **asked), NOW_NS)
    assert outcome.accepted is not bool(asked)
    assert known.answered(note("a", origin="192.0.2.1", **asked)) == outcome
    assert known.answered(note("b")) is None


CHANGES = {"note": "x", "user": "Lee", "action": "part_replaced", "duration_s": 1.0}
CHANGES |= {"occurrence": 3}


@pytest.mark.parametrize("member", CHANGES)
def test_another_command_with_the_key_is_refused(member: str) -> None:
    known = monitor()
    known.obey(note("a"), NOW_NS)
    other = known.answered(note("a", **{member: CHANGES[member]}))
    assert other is not None
    assert (other.accepted, other.reused) == (False, True)


def test_every_member_of_a_command_is_compared_or_known_not_to_matter() -> None:
    assert set(Command.model_fields) == {*CHANGES, "alarm", "key", "origin"}


def test_the_oldest_make_room_and_the_rest_outlives_the_process() -> None:
    known, after = monitor(), monitor()
    for number in range(2 * MOST_ANSWERED):
        known.obey(note(str(number)), NOW_NS)
    after.restore(known.snapshot())
    found = [after.answered(note(str(number))) for number in range(2 * MOST_ANSWERED)]
    done = Outcome(accepted=True, message="greased (Kim)")
    assert found == [None] * MOST_ANSWERED + [done] * MOST_ANSWERED
