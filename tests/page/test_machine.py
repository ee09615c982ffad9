"""The page of a machine with several axes, of the real service, in a real browser."""

from typing import Any

import pytest

from .conftest import serious_faults

HEALTHY = {"scenario": "healthy"}
LOST = {"scenario": "sudden", "life_h": 1.0, "acceleration": 360.0, "hold_s": 2.0}
AXES = {name: LOST if name in ("Y", "C") else HEALTHY for name in "XYZABCUV"}
SIZES = [{"width": 1920, "height": 1080}, {"width": 360, "height": 740}]


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES, ids=["screen", "phone"])
def test_two_axes_in_fault_are_the_first_thing_that_is_seen(
    make_service: Any, open_page: Any, size: dict[str, int]
) -> None:
    service = make_service(axes=AXES)
    page = open_page(service.address, size=size, bypass_csp=True).page
    page.wait_for_selector("#machine-answer:has-text('2 of 8 axes are not all right: Y and C')")
    assert page.get_attribute("#machine-answer", "data-condition") == "FAULT"
    assert page.title().startswith("FAULT")
    rows = page.locator(".axis-row")
    assert [rows.nth(i).get_attribute("data-condition") for i in (0, 1)] == ["FAULT", "FAULT"]
    assert rows.count() == len(AXES)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    top = rows.first.bounding_box()
    assert top["y"] + top["height"] < size["height"]
    assert serious_faults(page) == []
    page.click("#machine-alarms button[aria-label='Acknowledge: Y Sudden drop']")
    page.keyboard.press("Escape")
    rows.first.click()
    page.wait_for_selector("#answer[data-condition=FAULT]")
    assert page.evaluate("location.hash") in ("#/Y", "#/C")
    page.go_back()
    page.wait_for_selector("#machine-answer:visible")
    assert page.locator("[role=tabpanel]:visible").count() == 0


FALSE_GREEN = [
    ("NORMAL", [], "NORMAL"),
    ("NORMAL", [{"active": True, "severity": "error"}], "WARNING"),
    ("NORMAL", [{"active": True, "severity": "warning"}], "WARNING"),
    ("NORMAL", [{"active": False, "severity": "error"}], "NORMAL"),
    ("FAULT", [], "FAULT"),
    ("UNAVAILABLE", [{"active": True, "severity": "error"}], "UNAVAILABLE"),
]


def test_one_headline_is_as_grave_as_the_worst_axis(make_service: Any, open_page: Any) -> None:
    """Conditions and alarms of every kind, beside axes that are all right."""
    page = open_page(make_service(**HEALTHY).address).page
    for condition, alarms, expected in FALSE_GREEN:
        level = page.evaluate(
            """async ([condition, alarms]) => {
                const { levelOf, worstFirst } = await import("/static/level.js");
                const fine = { condition: "NORMAL", health: { alarms: [] } };
                const odd = { condition, health: { alarms } };
                return levelOf(worstFirst([fine, odd, fine])[0]);
            }""",
            [condition, alarms],
        )
        assert level == expected
