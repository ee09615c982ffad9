"""Nothing waits for ever unseen: a driver, a broker or a disk that never answers is shown."""

import ast
import asyncio
from collections.abc import AsyncGenerator
from typing import Any

import pytest

from drivers.base import Probe
from edge_service.messages.health import ComponentHealth, ComponentStatus
from edge_service.messages.samples import SampleFrame
from edge_service.messages.topics import STATUS
from edge_service.nodes import acquire_node
from edge_service.nodes.acquire_node import Silence
from edge_service.nodes.supervision.heartbeat import Heartbeat
from edge_service.nodes.supervision.supervisor import Supervisor

from ...documents import ROOT
from ..conftest import PATIENCE_S, config_of, running

UNLIMITED = {
    "edge_service/nodes/wiring/context.py": 1,  # a node whose tasks do the work
    "edge_service/nodes/acquire_node.py": 2,  # the same, and a machine, which may be silent
}
"""Places that may wait for ever while there is something to do, and why nothing is lost by it."""


def unlimited(text: str) -> int:
    """Number of times that a module is idle whatever waits for it."""
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    return sum(
        isinstance(each.func, ast.Attribute) and each.func.attr == "idle" and not each.args
        for each in calls
    )


def test_whoever_waits_says_that_there_is_nothing_to_do() -> None:
    paths = [path for house in ("edge_service", "drivers") for path in (ROOT / house).rglob("*.py")]
    found = {
        path.relative_to(ROOT).as_posix(): unlimited(path.read_text("utf-8")) for path in paths
    }
    assert {place: count for place, count in found.items() if count} == UNLIMITED


# drivers


async def never(*_args: Any) -> Any:
    """Never return."""
    await asyncio.Event().wait()


class HungDriver:
    """A driver one of whose calls never returns.

    Attributes:
        calls: of each kind, so far.
    """

    paced = True
    quiet_s = 0.0
    counters: dict[str, int] = {}
    readings: dict[str, float] = {}

    def __init__(self, hangs: str) -> None:
        self._hangs = hangs
        self.calls: list[str] = []

    async def _call(self, name: str) -> None:
        self.calls.append(name)
        if name == self._hangs:
            await never()

    async def open(self) -> None:
        await self._call("open")

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        await self._call("frames")
        raise RuntimeError("on purpose")
        yield

    async def probe(self) -> Probe:
        raise NotImplementedError

    async def close(self) -> None:
        await self._call("close")


async def report_of(driver: HungDriver, says: str, monkeypatch: pytest.MonkeyPatch) -> Supervisor:
    """Let an axis read from a driver until its component says something."""
    monkeypatch.setattr(acquire_node, "make_driver", lambda _axis: driver)
    supervisor = Supervisor()
    config = config_of("simulated", {})
    async with running(config, ("acquire",), supervisor=supervisor) as service:
        keys = config.keys
        reports = service.bus.subscribe(keys.all_components(STATUS), STATUS, depth=1024)

        async def said() -> ComponentHealth:
            async for _, _, report in reports:
                if report.component == "acquire" and says in report.reason:
                    return report
            raise AssertionError

        async with asyncio.timeout(PATIENCE_S):
            report = await said()
        assert report.status is ComponentStatus.RECOVERABLE_ERROR
        return supervisor


async def test_a_silent_machine_is_shown_as_no_data_and_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    driver = HungDriver("frames")
    await report_of(driver, "no data for ", monkeypatch)
    assert driver.calls[:2] == ["open", "frames"]
    assert driver.calls.count("frames") == 1  # no restart


async def test_a_driver_that_never_opens_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(acquire_node, "OPEN_S", 0.0)
    driver = HungDriver("open")
    await report_of(driver, "hangs", monkeypatch)
    assert driver.calls.count("open") == 1


async def test_a_driver_that_never_closes_is_left_and_begun_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(acquire_node, "LET_GO_S", 0.0)
    driver = HungDriver("close")
    await report_of(driver, "ended (RuntimeError", monkeypatch)
    assert driver.calls[:3] == ["open", "frames", "close"]


def test_silence_is_told_after_its_time_and_only_while_it_lasts() -> None:
    now_s = [0.0]
    silence = Silence(10.0, lambda: now_s[0])
    assert silence.problems() == []
    with silence.of_source():
        now_s[0] = 10.0
        assert silence.problems() == []
        now_s[0] = 12.0
        assert silence.problems() == ["no data for 12 s"]
    assert silence.problems() == []


@pytest.mark.parametrize(
    ("now_s", "expected_s"), [(10.25, 0.75), (10.0, 1.0), (9.9999, 1.0001), (10.98, 0.02)]
)
async def test_what_has_a_period_wakes_with_all_others_of_it(
    monkeypatch: pytest.MonkeyPatch, now_s: float, expected_s: float
) -> None:
    """A timer that was a little early is no second turn."""
    slept_s: list[float] = []

    async def sleep(seconds: float) -> None:
        slept_s.append(seconds)

    heart = Heartbeat("test", 1.0, lambda: now_s)
    with monkeypatch.context() as patch:
        patch.setattr(asyncio, "sleep", sleep)
        patch.setattr(asyncio.get_running_loop(), "time", lambda: now_s)
        await heart.next(1.0)
    assert slept_s == [pytest.approx(expected_s)]
