"""The clock is set: a monitor begins anew from its state, whose times make the same step."""

import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from edge_service.messages.health import AlarmKind, Command

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
