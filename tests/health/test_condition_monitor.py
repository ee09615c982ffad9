"""Scenarios of one axis: what is said, how fast, and how often."""

from dataclasses import replace

import pytest

from edge_service.health.statements import advice, headline
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition
from edge_service.messages.features import Fault
from edge_service.messages.health import ComponentHealth, ComponentStatus, Task

from ..messages.examples import estimate_of
from .conftest import Scene

NORMAL, WARNING = AxisCondition.NORMAL, AxisCondition.WARNING
FAULT, UNAVAILABLE = AxisCondition.FAULT, AxisCondition.UNAVAILABLE
STANDSTILL = EstimateStatus.INSUFFICIENT_EXCITATION
WELL, WIDE, UNBOUND = (9.5, 10), {"half_width": 1.0}, {"low": None, "high": None}
LEARNS = (None, 4, {"status": EstimateStatus.UNESTIMATED, "data_used_s": 0.5})
COURSES = {
    "a healthy axis": ([(9.5, 50)], "NORMAL"),
    "the first numbers of a worn axis": ([(1.0, 50)], "FAULT"),
    "one number after a second of learning": ([LEARNS, (9.5, 1)], "NORMAL"),
    "one number of a worn axis after learning": ([LEARNS, (1.0, 1)], "FAULT"),
    "flicker around a limit": ([WELL, (5.7, 10), *[(6.3, 3), (5.7, 3)] * 100], "NORMAL WARNING"),
    "above a limit, within the hysteresis": ([(5.0, 10), (6.4, 300)], "WARNING"),
    "above the hysteresis": ([(5.0, 10), (6.4, 300), (6.7, 10)], "WARNING NORMAL"),
    "a doubtful fault for 5 s": ([WELL, (2.8, 50, WIDE)], "NORMAL WARNING"),
    "a doubtful fault for 11 s": ([WELL, (2.8, 110, WIDE)], "NORMAL WARNING FAULT"),
    "no bounds for 5 s": ([WELL, (0.5, 50, UNBOUND)], "NORMAL"),
    "no bounds for 11 s": ([WELL, (0.5, 110, UNBOUND)], "NORMAL FAULT"),
    "every second estimate without a number": ([WELL, *[(0.5, 1), (None, 1)] * 5], "NORMAL FAULT"),
    "a standstill within the hysteresis": (
        [(5.0, 10), (None, 200), (6.2, 10)],
        "WARNING UNAVAILABLE WARNING",
    ),
    "a loss in silence": ([WELL, 3.0, (0.5, 10)], "NORMAL UNAVAILABLE FAULT"),
}
"""Percent, number of estimates and what else they say, or a silence, s; the conditions told."""


@pytest.mark.parametrize("course", COURSES)
def test_each_condition_is_told_once(course, scene):
    steps, conditions = COURSES[course]
    for step in steps:
        if isinstance(step, float):
            scene.wait(step)
        else:
            percent, count, *more = step
            said = dict(*more) or ({"status": STANDSTILL} if percent is None else {})
            scene.estimate(percent, steps=count, **said)
    assert scene.changes() == conditions.split()
    assert scene.condition == conditions.split()[-1]


def test_sudden_drop_is_a_fault_within_half_a_second(scene):
    scene.estimate(9.5, steps=50)
    dropped_ns = scene.now_ns
    scene.estimate(0.5, steps=10)
    event = next(event for event in scene.events if event.data.get("to") == "FAULT")
    assert event.time_ns - dropped_ns <= 0.5e9
    assert (event.level, event.data["preload_percent"]) == (FAULT, 0.5)


def test_slow_ramp_passes_warning_and_fault_once_each_at_their_limits(scene):
    seen = {}
    for percent in (9.0 - 0.02 * step for step in range(400)):
        scene.estimate(percent)
        seen.setdefault(scene.condition, percent)
    assert scene.changes() == ["NORMAL", "WARNING", "FAULT"]
    # The upper bound (+0.1) crosses the limit, then 0.3 s pass: 5 and 3 steps of 0.02 later.
    assert 6.0 - 0.1 - 5 * 0.02 <= seen[WARNING] < 6.0
    assert 3.0 - 0.1 - 5 * 0.02 <= seen[FAULT] < 3.0


def test_a_limit_inside_the_interval_is_said_to_be_in_doubt(scene):
    """The condition changes all the same, or a loss hid behind a wide interval for ever."""
    scene.estimate(9.5, steps=10)
    scene.estimate(5.5, half_width=4.0, steps=110)
    health = scene.monitor.health(scene.now_ns)
    assert health.condition is WARNING
    assert health.reasons == ("may_be_below_warning: the preload may be below 60 % of fresh",)
    assert headline(health).text == "The preload may be low: 55 % of fresh (15 to 95)."
    assert [each.task for each in advice(health, None)] == [Task.CONFIRM_LOSS]
    scene.silent(STANDSTILL, 1.0)  # without a number it is in doubt as before
    health = scene.monitor.health(scene.now_ns)
    assert headline(health).text == "The preload may be low."
    scene.estimate(5.5, half_width=0.4, steps=5)
    health = scene.monitor.health(scene.now_ns)
    assert health.reasons == ("below_warning: the preload is below 60 % of fresh",)
    assert headline(health).text == "The preload is low: 55 % of fresh (51 to 59)."
    assert [each.task for each in advice(health, None)] == [Task.PLAN_NUT]


def test_standstill_keeps_the_condition_for_the_grace_time_only(scene):
    scene.estimate(5.0, steps=10)
    scene.silent(STANDSTILL, 9.0)
    assert scene.condition is WARNING
    scene.silent(STANDSTILL, 2.0)
    assert scene.condition is UNAVAILABLE
    assert scene.reasons[0].startswith("no_number:")


def test_silence_is_unavailable_without_any_call_in_between(scene):
    scene.estimate(9.5, steps=10)
    health = scene.monitor.health(scene.now_ns + 3_000_000_000)
    assert health.condition is UNAVAILABLE
    assert health.reasons[0].startswith("stale_input:")


def test_late_arrival_of_old_data_is_stale(scene):
    scene.estimate(9.5, steps=10)
    old = replace(scene.header(), source_time_ns=scene.now_ns - 60_000_000_000)
    scene.monitor.on_preload(old, estimate_of(9.5), scene.now_ns)
    assert scene.condition is UNAVAILABLE


def test_unknown_fresh_preload_has_no_limit():
    scene = Scene(fresh_percent=None)
    scene.estimate(5.0, steps=50)
    assert scene.condition is UNAVAILABLE
    assert "fresh screw" in scene.reasons[0]


def test_status_changes_are_events_on_change_only(scene):
    scene.estimate(9.5, steps=10)
    scene.silent(STANDSTILL, 1.0)
    scene.silent(EstimateStatus.INVALID, 1.0)
    scene.estimate(9.5, steps=10)
    expected = ["estimated", "insufficient_excitation", "invalid", "estimated"]
    assert scene.changes("status_changed") == expected


def test_data_faults_are_counted_and_told_on_change_only(scene):
    for _ in range(10):
        scene.fault(Fault.GAP | Fault.NO_TABLE)
        scene.fault(Fault.NONE)
    scene.wait(10.0)
    told = [(event.data["fault"], event.data["state"]) for event in scene.events]
    faults = ("gap", "no_table")
    assert told == [(fault, state) for state in ("present", "over") for fault in faults]
    assert scene.monitor.health(scene.now_ns).data_faults == {"gap": 10, "no_table": 10}
    assert [event.level for event in scene.events[:2]] == [WARNING, NORMAL]


def test_silence_says_whether_data_still_come(scene):
    scene.estimate(9.5, steps=10)
    scene.wait(3.0)
    assert [reason.split(":")[0] for reason in scene.reasons] == ["stale_input", "no_data"]
    scene.fault(Fault.NONE)
    assert [reason.split(":")[0] for reason in scene.reasons] == ["stale_input"]


def test_component_that_falls_silent_is_in_error(scene):
    report = ComponentHealth(component="acquire", axis="X", status=ComponentStatus.OK)
    scene.events += scene.monitor.on_component(report, scene.now_ns)
    scene.wait(4.0)
    scene.wait(4.0)
    assert scene.changes("component_changed") == ["ok", "recoverable_error"]
    (shown,) = scene.monitor.health(scene.now_ns).components
    assert shown.status is ComponentStatus.RECOVERABLE_ERROR
    assert shown.reason.startswith("silent:")


def test_component_that_stopped_may_be_silent(scene):
    report = ComponentHealth(component="acquire", axis="X", status=ComponentStatus.STOPPED)
    scene.monitor.on_component(report, scene.now_ns)
    scene.wait(60.0)
    assert scene.monitor.health(scene.now_ns).components == (report,)
