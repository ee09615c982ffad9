"""The real service on a simulated drive, and a real browser that looks at its page."""

import asyncio
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings
from edge_service.config import DEFAULT_MACHINE, AxisConfig, EdgeConfig, HttpConfig
from edge_service.config.service import BusConfig
from edge_service.config_tables import AlarmsConfig, StoreConfig
from edge_service.nodes.context import NodeContext
from edge_service.nodes.service import PIPELINE, run_nodes

CHROMIUM = shutil.which("chromium")
PATIENCE_MS, PATIENCE_OF_SLOW_MS = 30_000, 120_000


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Debian's Chromium; ended with the module, for while it runs no other event loop may."""
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def serious_faults(page: Any) -> list[tuple[str, list[str]]]:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is missing")
    return [
        (fault["id"], [node["html"] for node in fault["nodes"]])
        for fault in axe.Axe().run(page).response["violations"]
        if fault["impact"] in ("serious", "critical")
    ]


def show_tab(page: Any, tab: str) -> None:
    page.click(f"#tab-{tab}")
    page.wait_for_selector(f"#{tab}:visible")


@dataclass
class Page:
    page: Any
    faults: list[str]
    asked: list[str]


@pytest.fixture
def open_page(browser: Any, request: pytest.FixtureRequest) -> Iterator[Callable[..., Page]]:
    """Opens pages; at the end none of them has complained or asked anything outside."""
    contexts, opened = [], []
    is_slow = request.node.get_closest_marker("slow") is not None

    def open_page(address: str, **options: Any) -> Page:
        context = browser.new_context(
            viewport={"width": 1440, "height": 900} | options.pop("size", {}), **options
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_OF_SLOW_MS if is_slow else PATIENCE_MS)
        seen = Page(page, [], [])
        page.on(
            "console",
            lambda message: (
                seen.faults.append(message.text) if message.type in ("error", "warning") else None
            ),
        )
        page.on("pageerror", lambda error: seen.faults.append(str(error)))
        page.on("request", lambda request: seen.asked.append(request.url))
        opened.append((address, seen))
        page.goto(address)
        return seen

    yield open_page
    for context in contexts:
        context.close()
    for address, seen in opened:
        ours = (address.partition("#")[0], "blob:")
        assert all(url.startswith(ours) for url in seen.asked)
        assert seen.faults == []


class Service:
    """The service in a thread of its own; `stop` ends it, `start` begins it at the same port."""

    def __init__(self, folder: Path, axes: dict[str, dict[str, Any]], http: HttpConfig) -> None:
        self._folder = folder
        self._http = http
        self._axes = axes
        self._port = 0
        self.address = ""

    def start(self) -> None:
        """Run until `stop`; returns once the page is served."""
        ready = threading.Event()
        self._thread = threading.Thread(target=asyncio.run, args=(self._run(ready),), daemon=True)
        self._thread.start()
        assert ready.wait(30.0)

    def stop(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(30.0)
            assert not self._thread.is_alive(), "the service did not end"

    async def _run(self, ready: threading.Event) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        axes = tuple(
            AxisConfig(name=name, machine=DEFAULT_MACHINE, driver="simulated", settings=settings)
            for name, settings in self._axes.items()
        )
        config = EdgeConfig(
            bus=BusConfig(endpoint="tcp/127.0.0.1:0"),
            http=self._http.model_copy(update={"port": self._port}),
            alarms=AlarmsConfig(rate_percent_per_1000_h=1e9),
            store=StoreConfig(folder=self._folder),
            axes=axes,
        )

        def on_ready(address: str) -> None:
            self.address = address
            self._port = int(address.rstrip("/").rpartition(":")[2])
            ready.set()

        bus = await Bus.open(BusSettings(config.bus.endpoint, "router"))
        try:
            await run_nodes(NodeContext(config, bus, on_ready), PIPELINE, self._stop)
        finally:
            await bus.close()


@pytest.fixture
def make_service(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    services: list[Service] = []

    def make(
        http: HttpConfig | None = None,
        axes: dict[str, dict[str, Any]] | None = None,
        **settings: Any,
    ) -> Service:
        axes = {"X": settings} if axes is None else axes
        service = Service(tmp_path, axes, http or HttpConfig())
        services.append(service)
        service.start()
        return service

    yield make
    for service in services:
        service.stop()
