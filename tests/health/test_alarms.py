"""Alarms: when they come and go, who has seen them, and what outlives a restart."""

import json

import numpy as np
import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.alarm_latch import AlarmLatch, AlarmRule
from edge_service.health.alarms import SuddenDrop
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.consistency import ConsistencyWatch
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition, Statement
from edge_service.messages.health import AlarmKind, Command, Consistency, ConsistencyState, Task
from edge_service.messages.trend import Trend, TrendStatus

from ..messages.examples import estimate_of

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
FACTS = ("X", 7.0, ScrewGeometry(0.02 / 6.283185307179586, 0.8))
CAUSE = Statement(text="because")


def _latch(delay_s: float = 0.0, clear_s: float = 0.0) -> AlarmLatch:
    return AlarmLatch("X", AlarmKind.MODEL, AlarmRule(AxisCondition.WARNING, delay_s, clear_s))


def _kinds(events: tuple) -> list[str]:
    return [event.kind for event in events]


def test_an_alarm_waits_its_delays_both_ways():
    latch = _latch(2.0, 5.0)
    steps = [(True, 0), (True, 1), (True, 2), (False, 3), (True, 6), (False, 7), (False, 11)]
    told = [latch.update(cause, CAUSE, at_s * NS) for cause, at_s in steps]
    assert [_kinds(each) for each in told] == [[], [], ["alarm_raised"], [], [], [], []]
    assert (told[2][0].level, told[2][0].text) == (AxisCondition.WARNING, "because")
    (cleared,) = latch.update(False, CAUSE, 12 * NS)
    assert (cleared.kind, cleared.code) == ("alarm_cleared", "alarm_over")


def test_an_alarm_nobody_saw_stays_until_somebody_has():
    latch = _latch()
    latch.update(True, CAUSE, 0)
    latch.update(False, CAUSE, NS)
    shown = latch.shown()
    assert not shown.active
    assert shown.text.startswith("The alarm “Model does not fit” held from ")
    assert _kinds(latch.acknowledge("Kim", "loose plug", 2 * NS)) == ["alarm_acknowledged"]
    assert latch.shown() is None
    assert latch.acknowledge("Kim", "", 3 * NS) == ()


def test_an_acknowledged_alarm_goes_when_its_cause_goes_and_asks_again_when_it_is_back():
    latch = _latch()
    latch.update(True, CAUSE, 0)
    latch.acknowledge("Kim", "", NS)
    assert latch.update(None, CAUSE, NS) == ()  # nobody can tell
    shown = latch.shown()
    assert (shown.active, shown.acknowledged_by) == (True, "Kim")
    latch.update(False, CAUSE, 2 * NS)
    assert latch.shown() is None
    latch.update(True, CAUSE, 3 * NS)
    assert latch.shown().acknowledged_by is None


def test_shelved_it_calls_nobody_and_comes_back_by_itself():
    latch = _latch()
    latch.shelve("Kim", "known", 100.0, 0)
    (raised,) = latch.update(True, CAUSE, NS)
    assert raised.level is AxisCondition.NORMAL
    assert latch.shown().shelved_until_ns == 100 * NS
    assert _kinds(latch.update(True, CAUSE, 100 * NS)) == ["alarm_unshelved"]
    assert latch.shown().shelved_until_ns is None


def test_a_drop_is_measured_from_the_greatest_value_of_its_time():
    """Against a search through everything that was seen."""
    rng = np.random.default_rng(1)
    drop, seen, found = SuddenDrop(limit_percent=1.0, within_s=10.0), [], 0
    for second in range(500):
        value = round(float(rng.normal(7.0, 1.0)), 1)  # values occur more than once
        low, high = value - rng.uniform(0.1, 2.0), value + rng.uniform(0.1, 2.0)
        recent = [each for each in seen if second - each[0] <= 10]
        best = max(recent, key=lambda each: each[2], default=(0, 0.0, 0.0))
        falls = bool(recent) and best[2] - value >= 1.0 and high < best[1]
        assert drop.update(second * NS, low, value, high) == (best[2] if falls else None)
        seen.append((second, low, value))
        found += falls
    assert found > 20


class Axis:
    def __init__(self, **alarms: float) -> None:
        self.now_ns = START_NS
        self.sequence = 0
        settings = AlarmsConfig(**alarms)
        self.watch = AxisMonitor(*FACTS, settings, self.now_ns)
        self.events: list[str] = []
        self.used_s, self.late_ns = 30.0, 0

    def hear(
        self, percent: float | None, seconds: float = 0.1, times: int = 1, **more: object
    ) -> None:
        """An estimate, after some time; several times."""
        for _ in range(times - 1):
            self.hear(percent, seconds, **more)
        self.now_ns += round(seconds * NS)
        self.sequence += 1
        header = Header(self.sequence, START_NS, self.now_ns - self.late_ns, self.now_ns)
        self.used_s += 0.1
        estimate = estimate_of(percent, **({"data_used_s": self.used_s, "nis": 1.0} | more))
        self.note(self.watch.on_preload(header, estimate, self.now_ns))

    def tick(self, seconds: float = 1.0) -> None:
        self.now_ns += round(seconds * NS)
        self.note(self.watch.tick(self.now_ns))

    def ask(self, action: str, alarm: str | None = None, note: str = "") -> None:
        command = Command(action=action, alarm=alarm, user="Kim", note=note)
        self.note(self.watch.on_command(command, self.now_ns))

    def note(self, events: tuple) -> None:
        self.events += [f"{e.kind}:{e.data.get('alarm', '')}".rstrip(":") for e in events]

    def shown(self) -> dict[str, bool]:
        alarms = self.watch.health(self.now_ns).alarms
        return {alarm.kind.value: alarm.active for alarm in alarms}


def _settled(percent: float = 7.0, **alarms: float) -> Axis:
    axis = Axis(**alarms)
    axis.hear(percent, times=150)
    axis.tick(0.0)
    assert axis.shown() == {}
    return axis


def acknowledge(occurrence: int | None) -> Command:
    alarm = AlarmKind.DATA_LOST
    return Command(action="acknowledge", alarm=alarm, occurrence=occurrence, user="Kim")


def test_an_acknowledgement_names_the_occurrence_that_it_means() -> None:
    latch = AlarmLatch("X", AlarmKind.DATA_LOST, AlarmRule(AxisCondition.WARNING, 0.0, 0.0))
    occurrences = []
    for at_ns in (5 * NS, 7 * NS):
        latch.update(True, CAUSE, at_ns)
        alarm = latch.shown()
        assert alarm is not None
        occurrences.append(alarm.occurrence)
        assert latch.refusal(acknowledge(alarm.occurrence)) == ""
        latch.update(False, CAUSE, at_ns + NS)
    first, second = occurrences
    assert first < second
    assert "is over" in latch.refusal(acknowledge(first))
    assert "no occurrence was named" in latch.refusal(acknowledge(None))
    restored = AlarmLatch("X", AlarmKind.DATA_LOST, latch.rule)
    restored.restore(latch.snapshot())
    restored.acknowledge("Kim", "", 9 * NS)
    assert "no alarm data_lost" in restored.refusal(acknowledge(second))
    restored.update(True, CAUSE, 0)
    again = restored.shown()
    assert again is not None
    assert again.occurrence > second


def test_a_sudden_drop_is_an_alarm_at_once_and_until_it_is_acknowledged():
    axis = _settled()
    axis.hear(1.0)
    assert axis.shown()["sudden_drop"]
    assert "alarm_raised:sudden_drop" in axis.events
    axis.hear(1.0, times=30)
    axis.tick(0.0)
    assert axis.shown() == {"sudden_drop": True, "preload_lost": True}
    axis.ask("acknowledge", "sudden_drop", "crash at 4 pm")
    assert "sudden_drop" not in axis.shown()


def test_finding_out_that_a_screw_is_worn_is_no_sudden_drop():
    axis = Axis()
    axis.used_s = 0.0
    for k in range(195):
        axis.hear(7.0 if k < 100 else 3.0)
    axis.tick(0.0)
    assert "sudden_drop" not in axis.shown()
    assert "preload_low" in axis.shown()


def test_a_drop_that_takes_a_second_is_one_alarm_with_the_whole_loss():
    axis = _settled()
    for percent in (5.5, 4.0, 2.5, 1.4, 1.4, 1.4):
        axis.hear(percent)
    assert axis.events.count("alarm_raised:sudden_drop") == 1
    (drop,) = (a for a in axis.watch.health(axis.now_ns).alarms if a.kind == "sudden_drop")
    assert "dropped from 100 to 20 % of fresh" in drop.text
    axis.ask("acknowledge", "sudden_drop")
    axis.hear(1.4, times=120)
    assert axis.events.count("alarm_raised:sudden_drop") == 1


def test_low_and_lost_follow_the_condition():
    axis = _settled()
    axis.hear(3.9, times=20)  # 56 % of 7: below 60, by more than 15 % at once
    axis.ask("acknowledge", "sudden_drop")
    axis.tick(0.0)
    assert axis.shown() == {"preload_low": True}
    axis.hear(1.0, times=20)
    axis.ask("acknowledge", "sudden_drop")
    axis.tick(0.0)
    assert axis.shown() == {"preload_lost": True}  # in place of the low one
    axis.hear(7.0, times=20)
    axis.tick(0.0)
    assert axis.shown() == {"preload_low": False, "preload_lost": False}


def test_who_acknowledges_the_loss_has_acknowledged_the_low_preload_too():
    axis = _settled()
    for percent in [3.9] * 20 + [1.0] * 20:
        axis.hear(percent)
    axis.tick(0.0)
    axis.ask("acknowledge", "preload_lost")
    axis.hear(7.0, times=20)
    axis.tick(0.0)
    assert not {"preload_low", "preload_lost"} & set(axis.shown())


def test_lost_data_are_an_alarm_and_hide_the_others_causes():
    axis = _settled()
    axis.tick(3.0)
    axis.tick(5.0)
    assert axis.shown() == {"data_lost": True}
    axis.hear(7.0, times=30)
    axis.tick(0.0)
    axis.tick(1.0)
    assert axis.shown() == {"data_lost": False}


@pytest.mark.parametrize("late_s", [0, 20])
def test_a_start_is_patient_with_data_that_have_not_come_or_have_waited(late_s):
    axis = Axis()
    axis.late_ns = late_s * NS
    if late_s:
        axis.hear(7.0)
    seen = [axis.tick(1.0) or "data_lost" in axis.shown() for _ in range(36)]
    assert (any(seen[:29]), seen[-1]) == (False, True)


def test_a_model_that_does_not_fit_is_an_alarm():
    axis = _settled()
    axis.hear(7.0, nis=30.0, times=150)
    axis.tick(0.0)
    axis.hear(7.0, 1.0, nis=30.0)
    axis.tick(0.0)
    axis.hear(7.0, nis=30.0, times=60)
    axis.tick(0.0)
    assert axis.shown() == {"model": True}


@pytest.mark.parametrize(("lost", "raised"), [(1.0, False), (0.1, True)])
def test_a_sure_loss_explains_that_the_axis_is_not_as_learned(lost, raised, monkeypatch):
    axis = _settled()
    found = Consistency(state=ConsistencyState.DISAGREES, channel="transmission_m")
    monkeypatch.setattr(ConsistencyWatch, "shown", lambda _self: found)
    for _ in range(20):
        axis.hear(0.5, 1.0, fault_probability={"preload_loss": lost})
        axis.tick(0.0)
    assert axis.shown().get("model", False) is raised
    after_inspection = axis.watch.health(axis.now_ns).advice[1].task
    assert after_inspection is (Task.DIAGNOSE if raised else Task.REPLACE_NUT)


def test_an_axis_at_rest_does_not_count_its_last_error_again_and_again():
    axis = _settled()
    axis.hear(7.0, nis=40.0)
    for _ in range(300):
        axis.hear(7.0, nis=40.0, data_used_s=axis.used_s)
    axis.tick(6.0)
    axis.tick(6.0)
    assert axis.shown().get("model") is None


@pytest.mark.parametrize(("used_s", "lasts_s"), [(3.0, 50), (25.0, 34), (25.0, 36)])
def test_a_state_that_is_still_being_found_or_a_short_doubt_calls_nobody(used_s, lasts_s):
    axis = _settled()
    for _ in range(10 * lasts_s):
        lost = {"status": EstimateStatus.INVALID, "reasons": ("model_mismatch: off",)}
        axis.hear(None, nis=None, data_used_s=used_s, **lost)
        axis.tick(0.0)
    assert axis.shown().get("model", False) is (lasts_s == 36)
    axis.hear(0.5, times=2)  # the model explains it again, by a loss
    assert not axis.shown().get("model", False)


def test_wearing_too_fast_is_an_alarm_only_beyond_doubt():
    def trend(low: float, high: float) -> Trend:
        rate = {"value": 0.5 * (low + high), "low": low, "high": high}
        return Trend(
            status=TrendStatus.FALLING, reason="", since_time_ns=0, rate_percent_per_h=rate
        )

    axis = _settled(rate_percent_per_1000_h=10.0)  # 0.7 points in 1000 h
    for high in (-0.4e-3, -0.8e-3):  # one look of many may lie beyond a 90 % interval
        axis.watch.take_trend(trend(-1.2e-3, high), axis.now_ns)
        axis.tick(0.1)
        assert axis.shown() == {}
    axis.watch.take_trend(trend(-1.1e-3, -0.9e-3), axis.now_ns)
    axis.tick(0.1)
    assert axis.shown() == {"rate": True}


def test_notes_and_new_parts_are_events_and_a_new_part_begins_anew():
    axis = _settled()
    axis.watch.take_trend(axis.watch.trend_work()(), axis.now_ns)
    assert axis.watch.health(axis.now_ns).trend is not None
    axis.ask("note", note="greased")
    axis.ask("part_replaced", note="nut replaced")
    assert axis.events[-2:] == ["note", "part_replaced"]
    health = axis.watch.health(axis.now_ns)
    assert health.trend is None
    assert health.use.since_time_ns == axis.now_ns
    assert axis.watch.trend_work()().status is TrendStatus.TOO_EARLY


def test_a_rise_that_wear_cannot_make_begins_the_trend_anew():
    axis = _settled(5.0)
    axis.hear(7.0, times=10)
    assert "preload_rose" not in axis.events  # not yet sure
    axis.hear(7.0, times=20)
    assert axis.events.count("preload_rose") == 1
    assert axis.watch.trend_work()().since_time_ns > START_NS + 14 * NS


def test_everything_outlives_a_restart():
    axis = _settled()
    axis.hear(1.0)
    axis.ask("shelve", "rate", "known")
    text = json.dumps(axis.watch.snapshot(), allow_nan=False)
    other = AxisMonitor(*FACTS, AlarmsConfig(), axis.now_ns)
    other.restore(json.loads(text))
    assert other.snapshot() == axis.watch.snapshot() | {"saved_ns": axis.now_ns}
    assert [alarm.kind.value for alarm in other.health(axis.now_ns).alarms] == ["sudden_drop"]


@pytest.mark.parametrize(
    "damage", [{"schema": "other/1"}, {"axis": "Y"}, {"alarms": 3}, {"series": {}}, {"use": None}]
)
def test_a_damaged_snapshot_is_refused(damage):
    axis = _settled()
    with pytest.raises(ValueError):
        axis.watch.restore(axis.watch.snapshot() | damage)
