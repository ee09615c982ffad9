"""The page that a person sees, and what it prints: of the real service, in a real browser."""

import json
import random
import re
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.config import HttpConfig
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.health.store.tokens import Tokens
from edge_service.http_api.app import STATIC
from edge_service.messages.interval import printed
from tests.certificates import write_certificates
from tests.programs import printed as program

from ..foreign_plant import axis_case, part_programme, simulate
from ..http_api.conftest import foreign_recording
from .conftest import serious_faults, show_tab

HEALTHY = {"scenario": "healthy"}
SUDDEN = {"scenario": "sudden", "life_s": 80.0, "hold_s": 4.0}
"""New for 44 s, for 20 of which it must have moved, then without any preload."""
BYTES_MOST, FIVE_MINUTES_MS = 300_000, 300_000
TABS = ("overview", "why", "history", "tests")


def test_the_page_is_light() -> None:
    assert sum(path.stat().st_size for path in STATIC.rglob("*")) < BYTES_MOST


@pytest.mark.slow
def test_a_drop_is_seen_understood_and_acknowledged(make_service: Any, open_page: Any) -> None:
    service = make_service(**SUDDEN)
    page = open_page(service.address, bypass_csp=True).page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    assert page.inner_text("#answer-title").split() == ["NORMAL", "Axis", "X"]
    assert re.search(r"95 % sure: [\d.]+ to [\d.]+ %", page.inner_text("#answer"))
    page.wait_for_selector("#answer[data-level=FAULT] .headline:has-text('The preload is lost: ')")
    text = page.inner_text("#answer")
    assert page.inner_text("#answer-title").split() == ["FAULT", "Axis", "X"]
    assert re.search(r"^The preload is lost: \d+ % of fresh \(\d+ to \d+\)\.$", text, re.MULTILINE)
    assert re.search(r"dropped from \d+ to \d+ % of fresh at ", page.inner_text("#alarms"))
    assert re.search(r"fell suddenly at [^,]+, from \d+ to \d+ % of fresh", text)
    assert "Not NORMAL since" in text
    assert "Replace or readjust the nut" in text
    assert (page.title(), serious_faults(page)) == ("FAULT: X", [])
    page.click("button[aria-label='Acknowledge: Sudden drop']")
    page.fill("#ask-user", "Kim")
    page.fill("#ask-note", "tool crash")
    page.press("#ask-user", "Enter")
    page.wait_for_selector("button[aria-label='Acknowledge: Sudden drop']", state="detached")
    show_tab(page, "history")
    page.wait_for_selector("#diary >> text=acknowledged by Kim: tool crash")


@pytest.mark.parametrize(
    ("scheme", "size"),
    [("light", {"width": 1920, "height": 1080}), ("dark", {"width": 360, "height": 740})],
)
def test_anybody_can_read_it(make_service: Any, open_page: Any, scheme: str, size: Any) -> None:
    """No fault that axe-core finds, nothing cut off."""
    service = make_service(**HEALTHY)
    page = open_page(service.address, color_scheme=scheme, size=size, bypass_csp=True).page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    for tab in TABS:
        show_tab(page, tab)
        assert serious_faults(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert tab != "why" or page.wait_for_selector("#second + ul > li.mode")  # five levels of it
    for link, card in (("Service", "#log li"), ("Set up", "#setup-axis li")):
        page.get_by_role("link", name=link, exact=True).click()
        page.wait_for_selector(card)
        assert serious_faults(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_keyboard_is_enough(make_service: Any, open_page: Any) -> None:
    page = open_page(make_service(**HEALTHY).address).page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    page.focus("#tab-overview")
    for tab in TABS[1:]:
        page.keyboard.press("ArrowRight")
        page.wait_for_selector(f"#tab-{tab}[aria-selected=true]:focus")
        assert page.evaluate("location.hash") == f"#/X/{tab}"
        assert page.locator("[role=tabpanel]:visible").count() == 1
    page.go_back()
    page.wait_for_selector("#tab-history[aria-selected=true]")
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.textContent.trim()"))
    assert {"Skip to the content", "History", "8 h", "Write a note", "Part replaced"} <= reached
    page.get_by_role("button", name="Write a note").focus()
    page.keyboard.press("Enter")
    page.keyboard.type("Kim")
    page.keyboard.press("Tab")
    page.keyboard.type("greased")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_selector("text=greased (Kim)")


def test_an_axis_and_its_limits_are_set_up_on_the_page(make_service: Any, open_page: Any) -> None:
    service = make_service(**HEALTHY)
    page = open_page(f"{service.address}#/setup").page
    page.wait_for_selector("#setup-axis li")
    page.fill("#setup-name", "Y")
    page.fill("#setup-driver", "simulated")
    page.fill("#setup-settings", 'scenario = "healthy"\nseed = 3')
    page.click("#setup-form button[type=submit]")
    page.wait_for_selector("#answer:has-text('Axis Y')")
    page.get_by_role("link", name="Set up").click()
    page.fill("#limit-warning_percent-Y", "70")
    page.click("button[aria-label='Save Y']")
    page.wait_for_selector("#setup-limits [role=status]:has-text('Limits of axis Y are saved.')")
    page.click("button[aria-label='Change Y']")
    assert page.input_value("#setup-settings") == 'scenario = "healthy"\nseed = 3\n'
    page.click("button[aria-label='Remove Y']")
    page.wait_for_selector("button[aria-label='Remove Y']", state="detached")


@pytest.mark.slow
def test_a_first_axis_comes_from_a_recording_by_the_page_alone(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    """On a phone, from a foreign recording of the new bench to its estimate, in five minutes."""
    foreign_recording(tmp_path / "trace.csv", 60.0)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG")
    phone = {"color_scheme": "dark", "size": {"width": 360, "height": 740}, "bypass_csp": True}
    page = open_page(make_service(axes={}).address, **phone).page
    page.set_default_timeout(FIVE_MINUTES_MS)
    begun_s = time.monotonic()
    read = "#first-form button[type=submit]:enabled"
    page.set_input_files("#first-file", tmp_path / "picture.png")
    page.click(read)
    page.wait_for_selector("#first-form [role=status]:has-text('a PNG image')")
    page.set_input_files("#first-file", tmp_path / "trace.csv")
    page.click("#first-form summary")
    sheet = {"drag": 0.146, "diameter": 20, "rating": 7.45, "preload": 510, "mass": 80}
    for key, value in sheet.items():
        page.fill(f"#first-{key}", str(value))
    page.press("#first-mass", "Enter")
    page.wait_for_selector("#first-form [role=status]:has-text('answer what is open')")
    page.fill("#first--torque-constant", "1.2")
    page.select_option("select[aria-label='Soll [mm] holds']", label="position of the table")
    page.click(read)
    page.wait_for_selector("#first-found .examined >> text=torque and position are read")
    assert "DOUBT" not in page.inner_text("#first-found")
    assert "inertia: 0.00150 kg m^2" in page.inner_text("#first-found")
    assert serious_faults(page) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.click("#commission-form button")
    page.wait_for_selector("#answer[data-level=NORMAL]")
    low, high = re.findall(r"95 % sure: ([\d.]+) to ([\d.]+) %", page.inner_text("#answer"))[0]
    assert float(low) <= 100.0 <= float(high)
    assert time.monotonic() - begun_s < FIVE_MINUTES_MS / 1e3


@pytest.mark.slow
def test_a_fingerprint_is_made_read_and_compared(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    from edge_service.config import DEFAULT_MACHINE, load_machine
    from edge_service.offline.simulate import SimulationSettings, simulate

    traces = []
    for seed in (1, 2):
        traces.append(tmp_path / f"accelerations_{seed}.parquet")
        settings = SimulationSettings("acceleration", seed=seed)
        simulate(load_machine(DEFAULT_MACHINE), settings, traces[-1])
    service = make_service(**HEALTHY)
    page = open_page(f"{service.address}#/X/tests").page
    page.set_input_files("#job-file", traces)
    for number, trace in enumerate(traces, 1):
        page.check(f"#tests [name=recording][value='{trace.name}']")
        page.click("#job-start")
        page.wait_for_selector(f"#tests a[href='/api/v1/jobs/{number}/files/report.html']")
        page.uncheck(f"#tests [name=recording][value='{trace.name}']")
    with page.expect_popup() as popup:
        page.click("#tests a[href='/api/v1/jobs/1/files/report.html']")
    popup.value.wait_for_load_state()
    assert "Inertia" in popup.value.inner_text("body")
    page.select_option("#compare-left", "1")
    page.select_option("#compare-right", "2")
    page.wait_for_selector("#tests table td:has-text('inertia')")
    with page.expect_download() as download:
        page.click("#tests a[href='/api/v1/jobs/1/files/fingerprint.json']")
    assert download.value.suggested_filename == "fingerprint_1_fingerprint.json"
    page.goto("about:blank")
    service.stop()
    service.start()
    page.goto(f"{service.address}#/X/tests")
    page.wait_for_selector("#tests a[href='/api/v1/jobs/2/files/report.html']")


@pytest.mark.slow
def test_recordings_of_two_days_are_compared_oldest_first(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    service = make_service(**HEALTHY)
    page = open_page(f"{service.address}#/X/tests", bypass_csp=True).page
    for seed, day in enumerate(("monday", "friday"), 1):
        programme = part_programme(np.random.default_rng(3), 150.0)
        made = simulate(axis_case(setpoint_m=programme, seed=seed, axis_seed=3))
        page.set_input_files("#job-file", made.write_csv(tmp_path / f"{day}.csv"))
        page.wait_for_selector(f"#tests [name=recording][value='{day}.csv']")
    show_tab(page, "history")
    page.check("#drift [value='friday.csv']")
    page.click("#drift-start")
    page.wait_for_selector("#drift [role=status]:has-text('two recordings')")
    page.check("#drift [value='monday.csv']")
    page.click("#drift-start")
    page.wait_for_selector("#drift a[href='/api/v1/jobs/1/files/report.html']")
    page.wait_for_selector("#drift-verdict:text-matches('^Compared: ')")  # a moment later
    assert "monday.csv → friday.csv" in page.inner_text("#drift")
    assert serious_faults(page) == []


FORMAT = Path(__file__).parents[2] / "edge_service" / "http_api" / "static" / "format.js"
NODE = shutil.which("node")


def cases() -> list[tuple[float, float, float]]:
    """Values with bounds from wide to so narrow that whole percents would hide them."""
    chance = random.Random(1)
    found = [(103.6, 97.2, 103.9), (104.2, 97.0, 104.2), (0.0, 0.0, 12.3)]
    for _ in range(500):
        value, reach = chance.uniform(0.1, 130.0), 10.0 ** chance.uniform(-3.0, 1.5)
        found.append((value, max(value - reach, 0.0), value + chance.random() * reach))
    return found


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_page_and_letters_print_alike(tmp_path: Path) -> None:
    assert NODE is not None
    (tmp_path / "strings.js").write_text(
        "export const locale = 'en-GB', counted = () => '';\n"
        "export const t = (_key, { low, high }) => `${low} ${high}`;\n"
    )
    (tmp_path / "format.js").write_text(FORMAT.read_text("utf-8"), "utf-8")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "run.js").write_text(
        "import { printed } from './format.js';\n"
        f"const cases = {json.dumps(cases())};\n"
        "const told = cases.map(([value, low, high]) => printed({ value, low, high }));\n"
        "console.log(JSON.stringify(told.map(({ value, bounds }) => `${value} ${bounds}`)));\n"
    )
    told = program(NODE, "run.js", folder=tmp_path)
    assert json.loads(told) == [" ".join(printed(*each)) for each in cases()]


def lose_the_answer(route: Any) -> None:
    assert route.fetch().status == 202
    route.abort()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["https", "http"])
def test_a_person_is_known_by_the_token(
    scheme: str, make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    tokens = Tokens(Store(tmp_path / FILE_NAME))
    kim = tokens.add("Kim", "operator", 0)
    tokens.add("screen", "viewer", 0)
    pair = dict.fromkeys(("certificate", "private_key"))
    if scheme == "https":
        pair["certificate"], pair["private_key"] = write_certificates(tmp_path)
    service = make_service(HttpConfig(**pair), scenario="healthy")
    assert service.address.startswith(f"{scheme}://")
    seen = open_page(
        service.address,
        bypass_csp=True,
        ignore_https_errors=True,
        http_credentials={"username": "whoever", "password": kim},
    )
    page = seen.page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    assert (serious_faults(page), page.context.cookies()) == ([], [])
    show_tab(page, "history")
    page.click("text=Write a note")
    assert page.input_value("#ask-user") == "Kim"
    assert not page.is_editable("#ask-user")
    page.fill("#ask-note", "looked at")
    page.route("**/commands", lose_the_answer, times=1)
    page.click("#ask-ok")
    page.wait_for_selector("#ask-error:has-text('It was not accepted')")
    page.click("#ask-ok")
    page.wait_for_selector("#ask", state="hidden")
    page.wait_for_selector('#diary :text("looked at (Kim)")')
    assert page.locator('#diary :text("looked at (Kim)")').count() == 1
    tokens.revoke("Kim")
    page.wait_for_selector("#banner:visible")  # the live stream has ended
    seen.faults[:] = [each for each in seen.faults if "40" not in each and "ERR_FAILED" not in each]


@pytest.mark.slow
def test_a_viewer_is_told_what_an_operator_may(
    make_service: Any, open_page: Any, tmp_path: Path
) -> None:
    screen = Tokens(Store(tmp_path / FILE_NAME)).add("screen", "viewer", 0)
    service = make_service(scenario="healthy")
    seen = open_page(service.address, http_credentials={"username": "", "password": screen})
    page = seen.page
    page.wait_for_selector("#answer[data-level=NORMAL]")
    show_tab(page, "history")
    page.click("text=Write a note")
    page.fill("#ask-note", "looked at")
    page.click("#ask-ok")
    page.wait_for_selector("#ask-error:has-text('this needs the role operator')")
    seen.faults[:] = [each for each in seen.faults if "status of 403" not in each]
