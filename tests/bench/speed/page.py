"""Time until a browser paints the page, and until it says how the machine is."""

import shutil
from typing import Any

CHROMIUM = shutil.which("chromium")
_FIRST_PAINT = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
_HEADLINE = "#answer[data-level=ok], #machine-answer[data-level=ok]"
_NOW = "performance.now()"


def page_times_ms(host: str, port: int, repeats: int) -> list[tuple[float, float]]:
    """First contentful paint, and the headline, after the start of the navigation, ms.

    Each time in a context of its own, so that nothing is cached. The headline is seen at the next
    frame that the browser draws.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        times = [_once(browser, f"http://{host}:{port}/") for _ in range(repeats)]
        browser.close()
    return times


def _once(browser: Any, address: str) -> tuple[float, float]:
    context = browser.new_context(bypass_csp=True)
    page = context.new_page()
    page.goto(address)
    page.wait_for_selector(_HEADLINE)
    headline_ms = page.evaluate(_NOW)
    painted_ms = page.evaluate(_FIRST_PAINT)
    context.close()
    return painted_ms, headline_ms
