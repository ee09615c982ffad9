"""The page of a machine with several axes, of the real service, in a real browser."""

import re
from typing import Any

import pytest

from .conftest import serious_faults

HEALTHY = {"scenario": "healthy"}
LOST = {"scenario": "sudden", "life_s": 80.0, "hold_s": 2.0}
AXES = {name: LOST if name in ("Y", "C") else HEALTHY for name in "XYZABCUV"}
SIZES = [{"width": 1920, "height": 1080}, {"width": 360, "height": 740}]


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES, ids=["screen", "phone"])
def test_two_axes_in_fault_are_the_first_thing_that_is_seen(
    make_service: Any, open_page: Any, size: dict[str, int]
) -> None:
    service = make_service(axes=AXES)
    page = open_page(service.address, size=size, bypass_csp=True).page
    page.wait_for_selector(
        "#machine-answer:has-text('2 of 8 axes need attention: Y (FAULT) and C (FAULT).')"
    )
    assert page.get_attribute("#machine-answer", "data-level") == "FAULT"
    assert page.title().startswith("FAULT: ")
    rows = page.locator(".axis-row")
    assert [rows.nth(i).get_attribute("data-level") for i in (0, 1)] == ["FAULT", "FAULT"]
    assert rows.count() == len(AXES)
    page.wait_for_function(
        """async () => {
            const { axes } = await (await fetch("/api/v1/axes")).json();
            const rows = [...document.querySelectorAll(".axis-row b")];
            return axes.map(({ axis }) => axis).join() === rows.map((row) => row.innerText).join();
        }"""
    )
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    # In one step: the rows are drawn anew at every answer.
    bottom = "document.querySelector('.axis-row').getBoundingClientRect().bottom"
    assert 0 < page.evaluate(bottom) < size["height"]
    assert serious_faults(page) == []
    page.click("#machine-alarms button[aria-label='Acknowledge: Y Sudden drop']")
    page.keyboard.press("Escape")
    rows.first.click()
    page.wait_for_selector("#answer[data-level=FAULT]")
    assert page.evaluate("location.hash") in ("#/Y", "#/C")
    page.go_back()
    page.wait_for_selector("#machine-answer:visible")
    assert page.locator("[role=tabpanel]:visible").count() == 0


def doctored(page: Any, change: str) -> None:
    """Let every live health answer pass through `change`, a function in JavaScript."""
    page.add_init_script(
        """(() => {
            const change = CHANGE;
            const add = EventSource.prototype.addEventListener;
            EventSource.prototype.addEventListener = function (name, take) {
                add.call(this, name, name !== "health" ? take : (message) => {
                    const data = JSON.stringify(change(JSON.parse(message.data)));
                    take({ data, lastEventId: message.lastEventId });
                });
            };
        })()""".replace("CHANGE", change)
    )
    page.reload()


SAYS = """(health) => ({
    ...health, condition: "%s", alarms: [],
    headline: { level: "%s", code: "%s", text: "Said.", values: { value: 41, low: 38, high: 44 } },
    advice: [{ task: "%s", text: "To do.", now: true, due: null, together_with: [] }],
})"""
CONTRARY = {
    "NORMAL FAULT fault replace_nut": ("ist verloren", "Mutter ersetzen oder nachstellen"),
    "FAULT NORMAL normal plan_nut": ("liegt in ihren Grenzen", "Einplanen, die Mutter"),
    "FAULT WARNING may_be_warning confirm_loss": ("ist vielleicht niedrig", "Den Verlust"),
    "NORMAL WARNING new_code new_task": (None, "To do."),
}


@pytest.mark.parametrize("says", CONTRARY)
def test_level_and_advice_are_what_the_service_says(
    make_service: Any, open_page: Any, says: str
) -> None:
    """Whatever else the answer holds: the page judges nothing, it translates what it knows."""
    level, (said, to_do) = says.split()[1], CONTRARY[says]
    german = f"Die Vorspannung {said}: 41 % von neu (38 bis 44)." if said else "Said."
    address = make_service(**HEALTHY).address
    for locale, headline, task in (("en-GB", "Said.", "To do."), ("de-DE", german, to_do)):
        page = open_page(address, locale=locale).page
        doctored(page, SAYS % tuple(says.split()))
        page.wait_for_selector(f"#answer[data-level={level}] .todo:has-text('{task}')")
        assert page.inner_text("#answer .headline") == headline
        assert page.locator("#answer .todo li").count() == 1


ALARM = """active: true, occurrence: 7, level: "WARNING", raised_at: health.since,
    cleared_at: null, acknowledged_by: null, note: "", shelved_until: null"""
DOWN = """code: "part_down", text: "history does not work: the disk is full",
    values: { component: "history", reason: "the disk is full" }"""
SERVICE_DOWN = f"""(health) => ({{
    ...health, alarms: [{{ alarm: "service", {DOWN}, {ALARM} }}],
    headline: {{ level: "WARNING", {DOWN} }},
}})"""


def test_an_alarm_of_the_whole_service_stands_once_and_is_answered_once(
    make_service: Any, open_page: Any
) -> None:
    page = open_page(make_service(axes=dict.fromkeys("XYZ", HEALTHY)).address).page
    doctored(page, SERVICE_DOWN)
    page.wait_for_selector("#machine-answer[data-level=WARNING]")
    page.wait_for_selector("#machine-alarms:has-text('All axes: Service part down')")
    assert page.inner_text("#machine-title") == "A part of the service does not work"
    assert page.inner_text("#machine").count("Service part down") == 1
    assert page.inner_text("#machine").count("history does not work") == 1
    asked: list[tuple[str, int]] = []

    def take(route: Any) -> None:
        occurrence = route.request.post_data_json["occurrence"]
        asked.append((route.request.url.split("/axes/")[1], occurrence))
        route.fulfill(status=202, json={"outcome": ""})

    page.route("**/commands", take)
    page.click("#machine-alarms button[aria-label='Acknowledge: All axes Service part down']")
    page.fill("#ask-user", "Kim")
    page.press("#ask-user", "Enter")
    page.wait_for_selector("#ask", state="hidden")
    assert sorted(asked) == [(f"{x}/commands", 7) for x in "XYZ"]


MODEL_ALARM = f"""(health) => ({{ ...health, alarms: [{{
    alarm: "model", code: "model_misfit", text: "the model does not fit", values: {{ times: 9 }},
    {ALARM}
}}] }})"""


@pytest.mark.slow
def test_a_lost_connection_is_reported_and_made_again(make_service: Any, open_page: Any) -> None:
    """Meanwhile no axis or part is claimed to be anything, and no alarm to be there or not."""
    service = make_service(axes=dict.fromkeys("XYZ", HEALTHY))
    places = ("", "#/X", "#/X/why", "#/service")
    seen = [open_page(f"{service.address}{place}") for place in places]
    machine, axis, why, parts = (each.page for each in seen)
    why.wait_for_selector("#model :text('Yes.')")
    parts.wait_for_selector("#service-state")
    doctored(machine, MODEL_ALARM)
    machine.wait_for_selector("#machine-alarms:has-text('X: Model does not fit')")
    axis.wait_for_selector("#answer[data-level=NORMAL]")
    service.stop()
    for page, part in ((machine, "#machine"), (axis, "#overview")):
        page.wait_for_selector("#banner:not([hidden])")
        said = r"No connection to the service since .*\. Everything on this page is old"
        assert re.match(said, page.inner_text("#banner"))
        page.wait_for_selector(f"{part}:has-text('Not known now.')")
        claims = "NORMAL|FAULT|UNAVAILABLE|No alarm|Model does|judged|% of fresh"
        assert not re.search(claims, page.inner_text(part))
        assert page.title() == "connection lost"
    why.wait_for_selector("#why", state="hidden")
    parts.wait_for_selector("#parts", state="hidden")
    service.start()
    for page in (machine, axis):
        page.wait_for_selector("#banner", state="hidden")
    axis.wait_for_selector("#answer[data-level=NORMAL]")
    lost = re.compile("ERR_(CONNECTION_REFUSED|INCOMPLETE_CHUNKED|CONNECTION_RESET)")
    for each in seen:
        each.faults[:] = [fault for fault in each.faults if not lost.search(fault)]


DISAGREES = """(health) => ({
    ...health,
    consistency: {
        state: "disagrees", ratio: { torque_nm: 1.1, transmission_m: 310.0 },
        channel: "transmission_m", since: health.since, recording: null,
    },
})"""


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (MODEL_ALARM, "“Model does not fit” is active"),
        (DISAGREES, "table against the motor is 310"),
    ],
)
def test_the_model_does_not_fit_beside_what_speaks_against_it(
    make_service: Any, open_page: Any, change: str, named: str
) -> None:
    """However small the estimator's own error is: the two are different quantities."""
    page = open_page(f"{make_service(**HEALTHY).address}#/X/why").page
    page.wait_for_selector("#model :text('times what it expects')")
    page.wait_for_selector("#model :text-is('Yes.')")
    doctored(page, change)
    page.wait_for_selector(f"#model :text('{named}')")
    page.wait_for_selector("#model :text('times what it expects')")
    assert "No: model and axis disagree." in page.inner_text("#model")
    assert "Yes" not in page.inner_text("#model")


FALLING = """(health) => {
    const at = (seconds) => new Date(Date.parse(health.since) + 1000 * seconds).toISOString();
    const crossing = { limit: "warning", limit_percent: 4, likely: at(2400), latest: at(3600) };
    return { ...health, trend: { status: "falling", reason: "", since: at(-900), until: at(900),
        level: 0.9, change_fresh_percent: -9, crossings: [{ ...crossing, earliest: at(1800) }],
        rate_fresh_percent_per_h: { value: -36, low: -40, high: -30 } } };
}"""


def test_the_tense_is_that_of_the_service_whatever_the_readers_clock_shows(
    make_service: Any, open_page: Any
) -> None:
    page = open_page(make_service(**HEALTHY).address).page
    page.add_init_script("const now = Date.now; Date.now = () => now() + 7200000")
    doctored(page, FALLING)
    page.wait_for_selector("#answer:has-text('has been falling by 0.6 % of fresh per minute')")
    assert "The warning limit will be reached between" in page.inner_text("#answer")
