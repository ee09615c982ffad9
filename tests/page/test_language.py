"""Languages of the page: the same keys in each, and no word from anywhere else."""

import json
import re
from collections.abc import Iterable
from typing import Any, get_args

import pytest

from edge_service.health.consistency import CHANNELS
from edge_service.http_api.app import STATIC
from edge_service.http_api.jobs import JobCommand, JobState
from edge_service.messages.event import AxisCondition, Code
from edge_service.messages.features import Fault
from edge_service.messages.health import AlarmKind, ComponentStatus, ConsistencyState
from edge_service.messages.keys import COMPONENTS
from edge_service.models.motions.registry import MOTIONS

from .conftest import show_tab

STRINGS = STATIC / "strings"
LINE = re.compile(r'^  "([^"]+)": (".*"),$', re.MULTILINE)
PLACE = re.compile(r"\{\w+\}")
USED = re.compile(
    r'\b(?:t|counted)\(\s*(?:\w+ \? )?"([^"]+)"(?: : "([^"]+)")?|data-t(?:-label)?="([^"]+)"'
)
TABS = ("overview", "why", "history", "tests")
SHOWN = """() => {
    const isShown = (node) =>
        node.checkVisibility() && !node.closest("script, style, [lang=en]");
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    const found = [];
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        if (isShown(node.parentElement)) found.push(node.data.trim());
    }
    const named = [...document.querySelectorAll("[aria-label]")];
    return [...found, ...named.map((node) => node.getAttribute("aria-label"))];
}"""


def words(language: str) -> dict[str, str]:
    text = (STRINGS / f"{language}.js").read_text(encoding="utf-8")
    return {key: json.loads(value) for key, value in LINE.findall(text)}


def test_both_languages_have_the_same_keys_with_the_same_places() -> None:
    english, german = words("en"), words("de")
    assert len(english) > 300
    own = ("said.", "reason.", "task.", "sensor.", "missing.")  # English is the service's own
    assert {key for key in german if not key.startswith(own)} <= english.keys() <= german.keys()
    for key, text in english.items():
        assert sorted(PLACE.findall(text)) == sorted(PLACE.findall(german[key])), key


def test_every_key_in_use_has_its_words() -> None:
    known = words("en").keys()
    for path in (*STATIC.glob("*.js"), *STATIC.glob("*.html")):
        if path.name.startswith("uplot"):
            continue
        for key in filter(None, sum(USED.findall(path.read_text(encoding="utf-8")), ())):
            assert key in known or f"{key}.one" in known, (path.name, key)


CODES: dict[str, Iterable[str]] = {
    "alarm": AlarmKind,
    "condition": AxisCondition,
    "model.learned": ConsistencyState,
    "watched": CHANNELS,
    "part": ComponentStatus,
    "component": {each.removesuffix("_process") for each in COMPONENTS},
    "job.command": get_args(JobCommand),
    "job.state": get_args(JobState),
    "fault": [str(fault.name).lower() for fault in Fault],
    "said": [each.name.lower() for each in Code if re.search(r"{(time|since|until)}", each.value)],
    "motion": [name for name, motion in MOTIONS.items() if motion.draw],
}


@pytest.mark.parametrize("kind", CODES)
def test_every_code_of_the_service_has_its_words(kind: str) -> None:
    known = {key.removesuffix(".one") for key in words("en")}
    assert {f"{kind}.{code}" for code in CODES[kind]} <= known


def unreadable(route: Any) -> None:
    """German without a letter: each is a dot below the line, so whatever has letters is not its."""
    text = {
        key: value if key == "language" else re.sub(r"(?![^{]*\})[^\W\d_]", "․", value)
        for key, value in words("de").items()
    }
    body = f"export const de = {json.dumps(text)};"
    route.fulfill(body=body, content_type="text/javascript")


@pytest.mark.slow
def test_no_word_is_shown_from_elsewhere(make_service: Any, open_page: Any) -> None:
    """Words of the service itself are English, and say so; the name of a method is no word."""
    service = make_service(scenario="healthy")
    page = open_page(service.address, locale="de-DE").page
    page.route("**/static/*/strings/de.js", unreadable)
    page.reload()
    page.wait_for_selector("#answer[data-level=NORMAL]")
    for tab in TABS:
        show_tab(page, tab)
        page.wait_for_timeout(1500)
        shown = [each.replace("kf-imm", "") for each in page.evaluate(SHOWN)]
        strange = [each for each in shown if re.search(r"[^\W\d_]{3,}", each)]
        assert set(strange) <= {"English", "Deutsch", "CSV", "PARQUET"}, tab


@pytest.mark.slow
def test_the_language_is_the_browsers_and_can_be_changed(make_service: Any, open_page: Any) -> None:
    page = open_page(make_service(scenario="healthy").address, locale="de-DE").page
    page.wait_for_selector("text=Achse X")
    assert page.get_attribute("html", "lang") == "de"
    page.select_option("#language", "en")
    page.wait_for_selector("text=Axis X")
    page.reload()
    page.wait_for_selector("text=Axis X")
