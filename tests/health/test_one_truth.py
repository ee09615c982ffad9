"""Whatever happens to an axis, no statement contradicts another, in one answer or two outputs."""

import re

from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.config_tables import AlarmsConfig
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.components import ComponentWatch
from edge_service.health.service_state import AxisState, ServiceState
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition, Event
from edge_service.messages.health import AlarmKind, AxisHealth, Command, Task
from edge_service.messages.interval import Interval
from edge_service.messages.trend import Crossing, Trend, TrendStatus
from edge_service.outputs.mqtt import health_of
from edge_service.outputs.mtconnect import values_of
from edge_service.outputs.opcua_nodes import data_values

from ..messages.examples import estimate_of

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
FRESH = 7.0
FACTS = ("X", FRESH, ScrewGeometry(0.02 / 6.283185307179586, 0.8))
PRESENT = re.compile(r"(?:is|may be) .*?([\d.]+) % of fresh(?: \(|\.)")


class Axis:
    """Axis that is told what a test draws, a second after the other."""

    def __init__(self) -> None:
        self.now_ns = START_NS
        self.sequence, self.events = 0, list[Event]()
        self.monitor = AxisMonitor(*FACTS, AlarmsConfig(), START_NS)
        self.state = AxisState("X", None, ComponentWatch(5.0))

    def hear(self, estimate: PreloadEstimate, seconds: int) -> None:
        for _ in range(seconds * 5 or 1):
            self.wait(0.2)
            self.sequence += 1
            header = Header(self.sequence, START_NS, self.now_ns, self.now_ns)
            fresh = estimate.model_copy(update={"data_used_s": 30.0 + self.sequence})
            self.events += self.monitor.on_preload(header, fresh, self.now_ns)
            self.state.preload.hear(header, fresh, self.now_ns)

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)
        self.events += self.monitor.tick(self.now_ns)

    def answer(self) -> AxisHealth:
        return self.monitor.health(self.now_ns)


def _estimate(share: float, width: float, nis: float, grease: float) -> PreloadEstimate:
    percent = FRESH * share
    more = {"nis": nis, "fault_probability": {"lubrication": grease}}
    return estimate_of(percent, width, low=max(percent - width, 0.0), **more)


def _trend(status: TrendStatus, rate: float, days: int) -> Trend:
    sign = {TrendStatus.FALLING: -1.0, TrendStatus.RISING: 1.0}.get(status, 0.0)
    crossings = [
        Crossing(
            limit=name,
            limit_percent=share * FRESH,
            earliest_ns=START_NS + days * 86400 * NS,
            likely_ns=None,
            latest_ns=None,
        )
        for name, share in (("warning", 0.6), ("fault", 0.3))
    ]
    known = status is not TrendStatus.TOO_EARLY
    interval = Interval(value=sign * rate, low=sign * rate - 0.1 * rate, high=sign * rate)
    return Trend(
        status=status,
        reason="",
        since_time_ns=START_NS,
        rate_percent_per_h=interval if known else None,
        crossings=tuple(crossings) if status is TrendStatus.FALLING else (),
    )


ESTIMATES = st.builds(
    _estimate,
    st.floats(0.02, 1.3),
    st.floats(0.01, 2.0),
    st.sampled_from([0.5, 1.0, 50.0]),
    st.sampled_from([0.0, 0.95]),
) | st.sampled_from(
    [
        PreloadEstimate(time_s=0.0, status=status)
        for status in EstimateStatus
        if status is not EstimateStatus.ESTIMATED
    ]
)
TRENDS = st.builds(
    _trend, st.sampled_from(TrendStatus), st.floats(1e-5, 100.0), st.integers(0, 1000)
)
STEPS = st.lists(
    st.tuples(st.just("hear"), ESTIMATES, st.integers(0, 15))
    | st.tuples(st.just("wait"), st.integers(1, 20))
    | st.tuples(st.just("trend"), TRENDS)
    | st.tuples(st.just("acknowledge"), st.sampled_from(AlarmKind))
    | st.tuples(st.just("part_replaced")),
    min_size=1,
    max_size=12,
)


def _do(axis: Axis, step: tuple) -> None:
    match step:
        case "hear", estimate, seconds:
            axis.hear(estimate, seconds)
        case "wait", seconds:
            axis.wait(seconds)
        case "trend", trend:
            newest = trend.model_copy(update={"until_time_ns": axis.now_ns})
            axis.monitor.take_trend(newest, axis.now_ns)
        case action, *alarm:
            kind = alarm[0] if alarm else None
            axis.monitor.on_command(Command(action=action, alarm=kind, user="Kim"), axis.now_ns)


@settings(deadline=None)  # the machine may be busy
@given(STEPS)
def test_no_statement_contradicts_another(steps: list[tuple]) -> None:
    axis = Axis()
    for step in steps:
        _do(axis, step)
        health = axis.answer()
        _headline_fits(health)
        tasks = [each.task for each in health.advice]
        assert len(tasks) == len(set(tasks))
        unseen = any(alarm.acknowledged_by is None for alarm in health.alarms)
        assert (Task.ACKNOWLEDGE in tasks) == unseen
        work = [each for each in health.advice if each.task is not Task.ACKNOWLEDGE]
        assert work or health.headline.level is AxisCondition.NORMAL
        nut = {Task.REPLACE_NUT, Task.CONFIRM_LOSS, Task.PLAN_NUT} & set(tasks)
        assert len(nut) <= 1
        assert not nut or health.headline.level is not AxisCondition.NORMAL
        if health.condition is AxisCondition.FAULT:
            assert all(each.now and each.due is None for each in health.advice)
        for each in health.advice:
            assert set(each.together_with) <= set(tasks) - {each.task}
        _texts_fit(health)
        _trend_fits(health, axis.now_ns)
        _outputs_agree(axis, health)


def _headline_fits(health: AxisHealth) -> None:
    assert health.headline is not None
    level = health.headline.level
    active = {alarm.kind for alarm in health.alarms if alarm.active}
    calm = health.condition is AxisCondition.NORMAL and not active
    assert (level is AxisCondition.NORMAL) == calm
    grave = health.condition is AxisCondition.FAULT or active & {
        AlarmKind.PRELOAD_LOST,
        AlarmKind.SUDDEN_DROP,
    }
    assert (level is AxisCondition.FAULT) == bool(grave)


def _texts_fit(health: AxisHealth) -> None:
    texts = [*health.reasons, *(alarm.text for alarm in health.alarms if alarm.active)]
    levels = {level for text in texts for level in PRESENT.findall(text)}
    assert len(levels) <= 1
    assert not (levels and health.condition is AxisCondition.UNAVAILABLE)
    for alarm in health.alarms:
        assert alarm.active is (alarm.code != "alarm_over")


def _outputs_agree(axis: Axis, health: AxisHealth) -> None:
    axis.state.health.hear(Header(0, START_NS, axis.now_ns, axis.now_ns), health, axis.now_ns)
    answer = axis.state.answer(START_NS, axis.now_ns)
    opcua = {name: each.Value and each.Value.Value for name, each in data_values(answer).items()}
    agent, broker, own = values_of(answer), health_of(answer), answer.health
    assert {opcua["Condition"], agent["condition_X", ""][0], broker["condition"]} == {own.condition}
    assert {opcua["Headline"].Text, broker["headline"]["text"]} == {own.headline.text}
    active = {each.kind for each in own.alarms if each.active}
    assert {code for name, code in agent if name == "alarms_X" and code} == active
    assert not (opcua["ModelFits"] and AlarmKind.MODEL in active)
    if answer.is_heard:
        assert (opcua["DeviceHealth"] == 0) is (own.headline.level is AxisCondition.NORMAL)
    rate = None if own.trend is None else own.trend.rate_fresh_percent_per_h
    assert opcua["PreloadRate"] is None or (rate and not rate.low <= 0.0 <= rate.high)
    if answer.estimate.status is EstimateStatus.ESTIMATED:
        assert not any(each.startswith("no_number") for each in own.reasons)
    if own.condition is AxisCondition.UNAVAILABLE:
        assert (opcua["PreloadOfRating"], agent["preload_X", ""]) == (None, ("UNAVAILABLE",))


def _trend_fits(health: AxisHealth, now_ns: int) -> None:
    trend = health.trend
    for each in () if trend is None else trend.crossings:
        assert min(time_ns for time_ns in (each.earliest_ns, each.likely_ns) if time_ns) >= now_ns
        assert "fell" not in trend.reason
    ahead = set() if trend is None else {each.limit for each in trend.crossings}
    if health.condition is AxisCondition.FAULT:
        assert not ahead
    assert not ("warning" in ahead and health.condition is AxisCondition.WARNING)
    falling = trend is not None and trend.status is TrendStatus.FALLING
    claims = [a for a in health.alarms if a.active and "falling fast" in a.text]
    assert falling or not claims


def test_a_fall_is_remembered_until_the_part_is_replaced_whoever_acknowledged_it() -> None:
    axis = Axis()
    axis.hear(_estimate(1.0, 0.05, 1.0, 0.0), 20)
    axis.hear(_estimate(0.17, 0.05, 1.0, 0.0), 20)
    _do(axis, ("acknowledge", AlarmKind.SUDDEN_DROP))
    axis.hear(_estimate(0.17, 0.05, 1.0, 0.0), 60)
    fall = axis.answer().fall
    assert fall is not None
    assert (round(fall.from_percent), round(fall.to_percent)) == (100, 17)
    again = AxisMonitor(*FACTS, AlarmsConfig(), axis.now_ns)
    again.restore(axis.monitor.snapshot())
    assert again.health(axis.now_ns).fall == fall
    _do(axis, ("part_replaced",))
    assert axis.answer().fall is None


def test_each_fall_is_told_and_a_new_part_ends_them() -> None:
    axis, seen = Axis(), []
    for share in (1.0, 0.5, 0.1):
        axis.hear(_estimate(share, 0.05, 1.0, 0.0), 25)
        seen += [each for each in axis.answer().alarms if each.kind is AlarmKind.SUDDEN_DROP]
    assert ["from 100 to 50" in seen[0].text, "from 50 to 10" in seen[1].text] == [True, True]
    assert seen[1].occurrence > seen[0].occurrence
    _do(axis, ("part_replaced",))
    axis.hear(_estimate(1.0, 0.05, 1.0, 0.0), 5)
    assert not any(each.active for each in axis.answer().alarms)


def test_grease_is_a_task_of_its_own_and_belongs_into_the_stop_for_the_nut() -> None:
    axis = Axis()
    axis.hear(_estimate(1.0, 0.05, 1.0, 0.95), 20)
    (grease,) = axis.answer().advice
    assert grease.task is Task.REGREASE
    axis.hear(_estimate(0.2, 0.05, 1.0, 0.95), 20)
    nut = next(each for each in axis.answer().advice if each.task is Task.REPLACE_NUT)
    assert nut.together_with == (Task.REGREASE,)
    grease = {"lubrication": 0.95}
    invalid = PreloadEstimate(time_s=0.0, status=EstimateStatus.INVALID, fault_probability=grease)
    axis.hear(invalid, 1)
    assert Task.REGREASE not in {each.task for each in axis.answer().advice}


def test_what_percent_needs_is_not_said_to_be_the_fresh_preload() -> None:
    axis, why = Axis(), "no_percent: model.preload_drag_nm is unknown"
    axis.hear(PreloadEstimate(time_s=0.0, status=EstimateStatus.ESTIMATED, reasons=(why,)), 20)
    told = axis.answer()
    assert told.headline.text == "The machine file lacks what preload in % needs."
    assert told.reasons == (why,)
    assert [each.task for each in told.advice] == [Task.COMPLETE_MACHINE_FILE]


def test_a_test_that_is_due_is_a_task() -> None:
    axis = Axis()
    due = "test_due: no test yet, and the interval is 5.0 points wide: run a test"
    axis.hear(_estimate(1.0, 0.05, 1.0, 0.0).model_copy(update={"reasons": (due,)}), 20)
    assert [each.task for each in axis.answer().advice] == [Task.TEST]


def test_whoever_presents_an_axis_forms_every_sentence_from_the_number_that_it_shows() -> None:
    axis = Axis()
    axis.hear(_estimate(1.0, 0.05, 1.0, 0.0), 10)
    axis.hear(_estimate(0.5, 0.05, 1.0, 0.0), 15)
    state, header = ServiceState({"X": None}, START_NS), Header(0, START_NS, axis.now_ns, 0)
    state.on_health(header, axis.answer(), axis.now_ns)
    state.on_preload("X", header, _estimate(0.45, 0.07, 1.0, 0.0), axis.now_ns)
    told, shown = state.health("X", axis.now_ns), state.preload("X", axis.now_ns)
    (low,) = [each for each in told.alarms if each.kind is AlarmKind.PRELOAD_LOW]
    assert low.text == "The preload is low: 45 % of fresh (44 to 46)."
    assert told.of_fresh == shown.of_fresh
    wide = _estimate(0.45, 1.4, 1.0, 0.0)  # the limit lies within
    state.on_preload("X", Header(1, START_NS, axis.now_ns, 0), wide, axis.now_ns)
    (low, *_) = [each for each in state.health("X", axis.now_ns).alarms if each.kind == low.kind]
    assert low.text == "The preload may be low: 45 % of fresh (25 to 65)."
    assert state.health("X", axis.now_ns).reasons[0].startswith("may_be_below_warning: ")


def test_a_fall_that_has_ended_is_told_in_the_past() -> None:
    axis, sound = Axis(), _estimate(1.0, 0.05, 1.0, 0.0)
    axis.hear(sound, 10)
    span = {"since_time_ns": axis.now_ns - 600 * NS, "until_time_ns": axis.now_ns}
    trend = _trend(TrendStatus.FALLING, 1.0, 100)
    trend = trend.model_copy(update=span | {"change_fresh_percent": -31.24})
    axis.monitor.take_trend(trend, axis.now_ns)
    axis.hear(sound, 1)
    (rate,) = axis.answer().alarms
    assert rate.text == "The preload is falling fast: 14.3 % of fresh per hour."
    axis.hear(sound, 70)
    health = axis.answer()
    assert health.alarms[0].text.startswith("The preload fell fast until ")
    assert health.trend is not None
    assert (health.trend.status, health.trend.rate_percent_per_h) == (TrendStatus.FELL, None)
    assert health.trend.reason.startswith("The preload fell by 31.2 % of fresh from ")
