"""Sentences of alarms and events: each code has its words, with the values that are sent."""

import ast
import re
from pathlib import Path
from string import Formatter

import pytest
from hypothesis import given, settings

import edge_service.health
from edge_service.health.alarm_latch import AlarmLatch, AlarmRule
from edge_service.health.axis_events import (
    clock_changed,
    consistency_changed,
    preload_rose,
    recording_kept,
    recording_name,
)
from edge_service.health.consistency import CHANNELS, Disagreement
from edge_service.health.inputs import DataFaults
from edge_service.http_api.app import words_in
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition, Code, Event, Statement, told
from edge_service.messages.features import Fault
from edge_service.messages.health import (
    Alarm,
    AlarmKind,
    AxisHealth,
    Command,
    ComponentHealth,
    ComponentStatus,
)
from edge_service.messages.interval import EXACT
from edge_service.messages.trend import TrendStatus
from edge_service.outputs.notify import sentence_in

from .health.test_one_truth import NS, START_NS, STEPS, Axis, _do, _estimate, _trend

HEALTH = Path(edge_service.health.__file__).parent


def in_german(said: Statement) -> str:
    """A statement in German; in English where there are no other words for it."""
    return sentence_in(words_in("de"), said) or said.text


NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
ENGLISH_ALONE = {Code.COMMAND_REFUSED, Code.PART_DOWN, Code.COMPONENT_CHANGED, Code.ESTIMATE_ANEW}
"""Codes whose reason is a part's own words, which no other language has."""
SAID_LESS = {AlarmKind.DATA_LOST, AlarmKind.SERVICE, AlarmKind.SUDDEN_DROP}
"""Alarms whose reason is a code in other languages, without its numbers."""


TIMES = {"time", "since", "until"}
"""Values that English says with one date for two of the same day."""
NAMES = {"user", "recording"} | TIMES
"""Values that no language has a word for."""


def names(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def test_each_code_has_german_words_with_the_same_values() -> None:
    for code in Code:
        values = names(code.value) - ({"reason"} if code in ENGLISH_ALONE else set())
        assert values == names(words_in("de")[f"said.{code.name.lower()}"]), code


def german(said: Statement) -> str:
    """The statement in German, once it is known to be whole and without English."""
    for name, value in said.values.items():
        if isinstance(value, str) and name not in NAMES:
            assert f"{name}.{value}" in words_in("de"), (name, value)
    text = in_german(said)
    assert text != said.text and "{" not in text
    return text


def numbers(text: str) -> list[float]:
    return sorted(float(each.replace(",", ".")) for each in NUMBER.findall(text))


def check_alarms(health: AxisHealth) -> None:
    """Each alarm says in German what it says in English, and outlives being stored."""
    for alarm in health.alarms:
        text = german(alarm)
        if alarm.kind not in SAID_LESS and not TIMES & alarm.values.keys():
            assert numbers(text) == numbers(alarm.text)
        assert Alarm.model_validate_json(alarm.model_dump_json(context=EXACT)) == alarm
    if health.headline is not None and "value" in health.headline.values:
        assert numbers(german(health.headline)) == numbers(health.headline.text)


@settings(deadline=None, max_examples=30)  # the machine may be busy
@given(STEPS)
def test_whatever_happens_each_alarm_has_its_german_words(steps: list[tuple]) -> None:
    axis = Axis()
    for step in steps:
        _do(axis, step)
        check_alarms(axis.answer())


def raised(kind: AlarmKind) -> Axis:
    axis = Axis()
    sound = _estimate(1.0, 0.1, 1.0, 0.0)
    axis.hear(sound, 10)
    match kind:
        case AlarmKind.PRELOAD_LOW:
            axis.hear(_estimate(0.5, 0.1, 1.0, 0.0), 15)
        case AlarmKind.PRELOAD_LOST | AlarmKind.SUDDEN_DROP:
            axis.hear(_estimate(0.1, 0.1, 1.0, 0.0), 15)
        case AlarmKind.RATE:
            axis.monitor.take_trend(_trend(TrendStatus.FALLING, 1.0, 100), axis.now_ns)
            axis.hear(sound, 1)
        case AlarmKind.MODEL:
            axis.hear(_estimate(1.0, 0.1, 50.0, 0.0), 15)
        case AlarmKind.DATA_LOST:
            for _ in range(20):
                axis.wait(1.0)
        case AlarmKind.SERVICE:
            report = ComponentHealth(
                component="acquire_process",
                axis="X",
                status=ComponentStatus.PERMANENT_ERROR,
                reason="host unreachable",
            )
            axis.monitor.on_component(report, axis.now_ns)
            axis.hear(sound, 1)
    return axis


@pytest.mark.parametrize("kind", AlarmKind)
def test_each_kind_of_alarm_is_told_in_german(kind: AlarmKind) -> None:
    health = raised(kind).answer()
    assert kind in {alarm.kind for alarm in health.alarms if alarm.active}
    check_alarms(health)


IN_ENGLISH = set[str]()
"""Events that parts tell in words of their own; notes are people's."""


def test_every_other_event_of_the_health_room_has_a_sentence() -> None:
    without = set()
    for path in HEALTH.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(func=ast.Name("Event"), keywords=members):
                    assert None in {each.arg for each in members}  # a whole statement
                case ast.Call(func=ast.Name("noted"), args=[_, kind, ast.Call(), *_]):
                    found = ast.walk(kind)  # words of its own, as no code has them
                    without |= {each.value for each in found if isinstance(each, ast.Constant)}
    assert without == IN_ENGLISH


def events() -> list[Event]:
    differs = [Disagreement(state, name, 9.0, 5.0) for state in (True, False) for name in CHANNELS]
    faults, found = DataFaults("X"), list[Event]()
    for fault in Fault:
        found += faults.count(fault, 0)
    found += faults.tick(10 * NS)
    found.append(preload_rose("X", 30.0, 100.0, 0))
    found += [consistency_changed("X", each, START_NS, START_NS) for each in differs]
    found += [clock_changed(step * NS, 0) for step in (-90_000, -3, 5, 7200)]
    found.append(recording_kept("X", recording_name("X", START_NS), 0))
    return found + answered() + conditions()


def answered() -> list[Event]:
    latch = AlarmLatch("X", AlarmKind.MODEL, AlarmRule(AxisCondition.WARNING, 0.0, 0.0))
    cause = told(Code.PRELOAD_FALLING, {"per": "per day"}, rate=7.0, per="day")
    return [
        *latch.update(True, cause, 0),
        *latch.acknowledge("Kim", "seen", 0),
        *latch.shelve("Kim", "", 60.0, 0),
        *latch.update(None, cause, 61 * NS),
        *latch.shelve("Kim", "known", 7200.0, 0),
        *latch.unshelve("Kim", "", 0),
        *latch.update(False, cause, NS),
    ]


def conditions() -> list[Event]:
    """Events of an axis that goes through its conditions."""
    axis = Axis()
    silent = [PreloadEstimate(time_s=0.0, status=each) for each in EstimateStatus]
    for estimate in (*(_estimate(each, 0.05, 1.0, 0.0) for each in (1.0, 0.5, 0.1, 1.0)), *silent):
        axis.hear(estimate, 30)
    axis.wait(60.0)
    return [each for each in axis.events if each.kind.endswith("_changed")]


def test_each_event_is_told_in_german_and_outlives_being_stored() -> None:
    found = events()
    assert {each.data["to"] for each in conditions()} >= {*AxisCondition, *EstimateStatus}
    found += Axis().monitor.on_command(Command(action="part_replaced", user="Kim"), 0)
    for event in found:
        assert german(event)
        assert Event.model_validate_json(event.model_dump_json(context=EXACT)) == event


def test_a_statement_of_a_later_version_is_told_in_english() -> None:
    later = Statement(code="not_yet_known", text="said so", values={"n": 3.0})
    assert in_german(later) == "said so"
