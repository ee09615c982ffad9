"""The page of a plant in a real browser."""

from collections.abc import Iterator
from typing import Any

import pytest

from ..nodes.fleet.plants import Plant, plant_in, until
from .conftest import serious_faults

pytestmark = pytest.mark.slow
MACHINES, AXES = 60, 4


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """A plant of 240 axes, one of which wears out; each machine has a log."""
    with plant_in(tmp_path_factory.mktemp("plant")) as plant:
        plant.node("one", keeps=True)
        more = ("--log", "first", "--logged", "20")
        plant.machines("--machines", str(MACHINES), "--axes", str(AXES), *more)
        until(lambda: plant.shows("one", MACHINES * AXES))
        yield plant


@pytest.fixture
def opened(plant: Plant, browser: Any) -> Iterator[Any]:
    """Opens the page, and sees that it makes no mistake."""
    pages, mistakes = [], []

    def open_at(width: int, language: str = "en-GB") -> Any:
        page = browser.new_page(viewport={"width": width, "height": 900}, locale=language)
        page.on("pageerror", lambda error: mistakes.append(str(error)))
        page.goto(f"{plant.urls['one']}/")
        page.wait_for_selector(".fleet-row")
        pages.append(page)
        return page

    yield open_at
    for page in pages:
        page.close()
    assert mistakes == []


def test_the_worst_axis_stands_first_and_says_why(opened: Any) -> None:
    page = opened(1400)
    assert "1 of 240 axes: act now" in page.inner_text("#fleet-title")
    first = page.inner_text(".fleet-row")
    assert "hall0 / m0000 / X" in first
    assert "faster than its 239 peers" in first
    assert page.locator(".fleet-row").count() == 200
    page.click("text=Next page")
    until(lambda: page.locator(".fleet-row").count() == 40)
    assert serious_faults(page) == []


def test_the_list_is_searched_and_filtered(opened: Any) -> None:
    page = opened(1400)
    page.fill("#fleet-search", "m0007")
    until(lambda: page.locator(".fleet-row").count() == 4)
    page.fill("#fleet-search", "")
    page.click("[data-condition=FAULT]")
    until(lambda: page.locator(".fleet-row").count() == 1)
    page.click("[data-condition=FAULT]")
    page.select_option("#fleet-site", "hall1")
    until(lambda: page.locator(".fleet-row").count() == 120)


def test_a_loss_that_may_be_none_is_not_shown_as_a_number(opened: Any) -> None:
    page = opened(1400)
    page.fill("#fleet-search", "m0007")
    until(lambda: page.locator(".fleet-row").count() == 4)
    assert page.locator(".fleet-row", has_text="none that is clear").count() == 1
    assert page.locator(".fleet-row", has_text="-0.5 to 1.5").count() == 1


def test_the_past_of_an_axis_opens_beneath_it(plant: Plant, opened: Any) -> None:
    until(lambda: plant.metric("one", "log_reports") >= 20 * MACHINES)
    page = opened(1400)
    page.click(".fleet-name")
    page.wait_for_selector(".fleet-past >> text=20 kept reports")
    page.wait_for_selector(".fleet-past canvas")
    page.wait_for_timeout(2500)  # the next answers leave it open
    assert page.locator(".fleet-past").count() == 1
    page.click(".fleet-name")
    assert page.locator(".fleet-past").count() == 0


@pytest.mark.parametrize("language", ["en-GB", "de-DE"])
def test_a_telephone_shows_it_without_scrolling_sideways(opened: Any, language: str) -> None:
    page = opened(360, language)
    page.click(".fleet-name")
    page.wait_for_selector(".fleet-past")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.get_attribute("html", "lang") == language[:2]
