"""Steps of the clock, told and untold, and commands that come again with their key."""

import math

import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.axis_monitor import MOST_ANSWERED, AxisMonitor
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from edge_service.messages.health import AlarmKind, Command, Outcome

from ..messages.examples import estimate_of

NS = 1_000_000_000
START_NS = 1_795_000_000 * NS
DAY_NS = 86400 * NS
STEPS_NS = [74 * 365 * DAY_NS, -56 * 365 * DAY_NS, 3600 * NS, -7200 * NS, 3 * NS, -3 * NS]
FACTS = ("X", 10.0, ScrewGeometry(0.02 / 6.28, 0.8))
STEPS, PERIOD_NS = 500, 200_000_000


def percent_at(number: int) -> float:
    """Falls all the time; once suddenly."""
    return 9.0 - 0.01 * number - (3.0 if number > 400 else 0.0)


def run(step_ns: int = 0) -> tuple[AxisMonitor, int]:
    """A monitor after 100 s, and the time then; the clock is set after 30 s, and nobody says so."""
    monitor, now_ns = AxisMonitor(*FACTS, AlarmsConfig(), START_NS), START_NS
    for number in range(STEPS):
        now_ns += PERIOD_NS + (step_ns if number == 150 else 0)
        header = Header(number, START_NS, now_ns, 0)
        values = dict.fromkeys(FEATURE_FIELDS, 1.0) | {"time_s": 0.2 * number}
        values |= {"fault": Fault.NONE, "sample_count": 3, "reversal_count": 1}
        monitor.on_preload(header, estimate_of(percent_at(number), time_s=0.2 * number), now_ns)
        monitor.on_feature(header, FeatureBlock(**values), now_ns)  # type: ignore[arg-type]
        monitor.tick(now_ns)
        if number == 100:
            kind = AlarmKind.PRELOAD_LOST
            shelve = Command(action="shelve", alarm=kind, user="Kim", duration_s=3600.0)
            monitor.on_command(shelve, now_ns)
    return monitor, now_ns


@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_even_a_step_that_nobody_tells_freezes_no_trend(step_ns: int) -> None:
    monitor, now_ns = run(step_ns)
    time_s, percent, *_ = monitor.trend_work().args
    assert time_s[-1] == pytest.approx(now_ns / NS, abs=3.0)
    assert percent[-1] == pytest.approx(percent_at(STEPS - 1), abs=0.1)


@pytest.mark.parametrize("step_ns", STEPS_NS)
@pytest.mark.parametrize("is_told", [True, False])
def test_a_kept_state_of_another_clock_goes_on(step_ns: int, is_told: bool) -> None:
    """At a start nobody tells the step: times after now are moved before it."""
    monitor, now_ns = run()
    again = AxisMonitor(*FACTS, AlarmsConfig(), now_ns + step_ns)
    again.restore(monitor.snapshot(), step_ns if is_told else 0)
    moved_ns = step_ns if is_told or step_ns < 0 else 0
    old_s, old_percent, *_ = monitor.trend_work().args
    time_s, percent, *_ = again.trend_work().args
    assert time_s == pytest.approx(old_s + moved_ns / NS, abs=1e-3)
    assert percent == pytest.approx(old_percent, rel=1e-12)
    before, after = monitor.health(now_ns), again.health(now_ns + step_ns)
    assert before.use is not None and after.use is not None
    assert after.use.since_time_ns - before.use.since_time_ns == moved_ns
    assert after.use.distance_m == before.use.distance_m
    raised = {each.kind: each for each in before.alarms}
    assert AlarmKind.PRELOAD_LOST in raised
    assert {each.kind for each in after.alarms} == raised.keys()
    for alarm in after.alarms:
        assert alarm.raised_time_ns - raised[alarm.kind].raised_time_ns == moved_ns
        until_ns = raised[alarm.kind].shelved_until_ns
        assert alarm.shelved_until_ns == (until_ns and until_ns + moved_ns)


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
