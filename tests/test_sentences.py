"""Sentences of alarms and events: each code has its words, with the values that are sent."""

import ast
import json
import re
import shutil
import subprocess
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
from edge_service.health.channel_model import CHANNELS
from edge_service.health.consistency import Disagreement
from edge_service.health.inputs import DataFaults
from edge_service.http_api.app import STATIC
from edge_service.http_api.words import words_in
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.event import Event, Severity
from edge_service.messages.features import Fault
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, AxisHealth, ComponentHealth, ComponentStatus
from edge_service.messages.sentence import ENGLISH, Code, Sentence, told
from edge_service.messages.trend import TrendStatus
from edge_service.outputs.notify import sentence_in

from .health.test_one_truth import NS, START_NS, STEPS, Axis, _do, _estimate, _trend

HEALTH = Path(edge_service.health.__file__).parent


def in_german(sentence: Sentence | None, message: str) -> str:
    """A sentence in German; the English message where there are no other words for it."""
    return message if sentence is None else sentence_in(words_in("de"), sentence) or message


NODE = shutil.which("node")
NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
ENGLISH_ALONE = {Code.PART_DOWN: {"reason"}}
"""Own words of a part, which no other language has."""
NAMES = {"user", "recording"}
"""Values that no language has a word for."""
SAID_LESS = {AlarmKind.DATA_LOST, AlarmKind.SERVICE}
"""Alarms whose reason is a code in other languages, without its numbers."""


def names(text: str) -> set[str]:
    """Names of the values in a text."""
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def sent() -> dict[Code, list[set[str | None]]]:
    """Names of the values that the health room sends with each code, from its own source."""
    found: dict[Code, list[set[str | None]]] = {code: [] for code in Code}
    for path in HEALTH.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "told":
                for part in ast.walk(node.args[0]):
                    if isinstance(part, ast.Attribute):
                        found[Code[part.attr]].append({each.arg for each in node.keywords})
    return found


def test_each_code_is_sent_with_the_values_that_each_language_shows() -> None:
    for code, calls in sent().items():
        assert calls, code
        for values in calls:
            assert values == names(ENGLISH[code]) - ENGLISH_ALONE.get(code, set())
            assert values == names(words_in("en")[f"said.{code}"]), code
            assert values == names(words_in("de")[f"said.{code}"]), code


def test_english_words_of_the_page_are_those_of_the_service() -> None:
    for code in set(Code) - set(ENGLISH_ALONE):
        plain = re.sub(r":[^{}]*\}", "}", ENGLISH[code])
        assert words_in("en")[f"said.{code}"] == plain


def samples() -> list[Sentence]:
    """Sentence of each code with numbers of many sizes; a name stands for every other value."""
    found = []
    for code in Code:
        specs = {name: spec for _, name, spec, _ in Formatter().parse(ENGLISH[code]) if name}
        for size in (0.0123, 0.26, 3.25, 27.4, 100.0):
            values = {name: size if spec else "Kim" for name, spec in specs.items()}
            sentence = told(code, **values).sentence
            assert sentence is not None
            found.append(sentence)
    return found


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_page_and_letters_say_alike(tmp_path: Path) -> None:
    assert NODE is not None
    shutil.copytree(STATIC / "strings", tmp_path / "strings")
    for name in ("strings.js", "format.js", "sentence.js"):
        shutil.copy(STATIC / name, tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "browser.js").write_text(
        "const navigator = { languages: ['de-DE'] }, localStorage = { getItem: () => null };\n"
        "for (const [name, value] of Object.entries({ navigator, localStorage }))\n"
        "  Object.defineProperty(globalThis, name, { value, configurable: true });\n"
    )
    cases = [each.model_dump(mode="json") for each in samples()]
    (tmp_path / "run.js").write_text(
        "import './browser.js';\nconst { sentenceWords } = await import('./sentence.js');\n"
        f"const cases = {json.dumps(cases)};\n"
        "console.log(JSON.stringify(cases.map((each) => sentenceWords(each, '').text)));\n"
    )
    done = subprocess.run(
        [NODE, "run.js"], cwd=tmp_path, check=True, capture_output=True, timeout=60
    )
    assert json.loads(done.stdout) == [in_german(each, "") for each in samples()]


def german(sentence: Sentence | None, message: str) -> str:
    """The sentence in German, once it is known to be whole and without English."""
    assert sentence is not None, message
    for name, value in sentence.values.items():
        if isinstance(value, str) and name not in NAMES:
            assert f"{name}.{value}" in words_in("de"), (name, value)
    text = in_german(sentence, message)
    assert text != message and "{" not in text
    return text


def numbers(text: str) -> list[float]:
    """Numbers in a text, smallest first."""
    return sorted(float(each.replace(",", ".")) for each in NUMBER.findall(text))


def check_alarms(health: AxisHealth) -> None:
    """Each alarm says in German what it says in English, and outlives being stored."""
    for alarm in health.alarms:
        text = german(alarm.sentence, alarm.message)
        if alarm.kind not in SAID_LESS:
            assert numbers(text) == numbers(alarm.message)
        assert Alarm.model_validate_json(alarm.model_dump_json()) == alarm


@settings(deadline=None, max_examples=30)  # the machine may be busy
@given(STEPS)
def test_whatever_happens_each_alarm_has_its_german_words(steps: list[tuple]) -> None:
    axis = Axis()
    for step in steps:
        _do(axis, step)
        check_alarms(axis.answer())


def raised(kind: AlarmKind) -> Axis:
    """An axis with an active alarm of a kind."""
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


IN_ENGLISH = {
    *("status_changed", "component_changed", "store_damaged", "command"),
    *("note", "part_replaced"),  # the words of a person
}
"""Events that parts and people tell in words of their own."""


def test_every_other_event_of_the_health_room_has_a_sentence() -> None:
    without = set()
    for path in HEALTH.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Event":
                members = {each.arg: each.value for each in node.keywords}
                if "sentence" not in members:
                    kinds = ast.walk(members["kind"])
                    without |= {each.value for each in kinds if isinstance(each, ast.Constant)}
    assert without == IN_ENGLISH


def events() -> list[Event]:
    """Events that an axis has in many ways."""
    differs = [Disagreement(state, name, 9.0, 5.0) for state in (True, False) for name in CHANNELS]
    faults, found = DataFaults("X", 1.0), list[Event]()
    for fault in Fault:
        found += faults.count(fault, 0)
    found += faults.tick(10 * NS)
    found += [preload_rose("X", 2.0, 7.0, fresh, 0) for fresh in (None, 7.0)]
    found += [consistency_changed("X", each, START_NS, START_NS) for each in differs]
    found += [clock_changed(step * NS, 0) for step in (-90_000, -3, 5, 7200)]
    found.append(recording_kept("X", recording_name("X", START_NS), 0))
    return found + answered() + conditions()


def answered() -> list[Event]:
    """Events of an alarm that people answer."""
    latch = AlarmLatch("X", AlarmKind.MODEL, AlarmRule(Severity.WARNING, 0.0, 0.0))
    cause = told(Code.MODEL_MISFIT, times=7.0)
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
    axis, found = Axis(), list[Event]()
    for share in (1.0, 0.5, 0.1, 1.0):
        for _ in range(150):
            axis.now_ns, axis.sequence = axis.now_ns + NS // 5, axis.sequence + 1
            header = Header(axis.sequence, START_NS, axis.now_ns, axis.now_ns)
            estimate = _estimate(share, 0.05, 1.0, 0.0)
            found += axis.monitor.on_preload(header, estimate, axis.now_ns)
    for _ in range(60):
        axis.now_ns += NS
        found += axis.monitor.tick(axis.now_ns)
    return [each for each in found if each.kind == "condition_changed"]


def test_each_event_is_told_in_german_and_outlives_being_stored() -> None:
    found = events()
    assert {each.data["to"] for each in conditions()} == set(AxisCondition)
    for event in found:
        assert german(event.sentence, event.message)
        assert Event.model_validate_json(event.model_dump_json()) == event


def test_what_was_stored_without_a_sentence_is_shown_as_it_is() -> None:
    alarm = raised(AlarmKind.PRELOAD_LOW).answer().alarms[0]
    old = alarm.model_dump(mode="json")
    del old["sentence"]
    loaded = Alarm.model_validate(old)
    assert loaded.sentence is None
    assert loaded.model_dump(mode="json") == old
    assert in_german(loaded.sentence, loaded.message) == alarm.message


def test_a_sentence_of_a_later_version_is_told_in_english() -> None:
    later = Sentence(code="not_yet_known", values={"n": 3.0})
    assert in_german(later, "said so") == "said so"
