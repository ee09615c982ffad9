"""The clock is set: everything that has a time moves along, and nothing else changes."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.limits import AlarmSettings
from edge_service.health.service_state import ServiceState
from edge_service.health.wear.trend import preload_trend
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.command import Command
from edge_service.messages.event import Event
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from edge_service.messages.health import AlarmKind, ComponentHealth, ComponentStatus

from ..messages.examples import estimate_of

NS = 1_000_000_000
START_NS = 1_795_000_000 * NS
DAY_NS = 86400 * NS
STEPS_NS = [74 * 365 * DAY_NS, -56 * 365 * DAY_NS, 3600 * NS, -7200 * NS, 3 * NS, -3 * NS]
FACTS = ("X", 10.0, ScrewGeometry(0.02 / 6.28, 0.8))
STEPS = 500
STEPS_AT = (150, 230, 401)
"""In the midst of data faults; without a number; with a sudden drop."""


def percent_at(number: int) -> float | None:
    """Falls all the time; once suddenly; without a number for a while."""
    if 220 <= number < 260:
        return None
    return 9.0 - 0.01 * number - (3.0 if number > 400 else 0.0)


class Run:
    """A monitor and a service state on a clock that is set once.

    Args:
        step_ns: by which it is set.
        step_at: number of the interval before which it is set.
        told: whether monitor and state are told.
    """

    def __init__(self, step_ns: int = 0, step_at: int = STEPS_AT[0], *, told: bool = True) -> None:
        self.monitor = AxisMonitor(*FACTS, AlarmSettings(), START_NS)
        self.state = ServiceState({"X": None}, START_NS)
        self.step_ns, self.step_at, self.told = step_ns, step_at, told
        self.now_ns = START_NS
        self.events: list[tuple[int, Event]] = []

    def go(self) -> list[dict[str, Any]]:
        """Everything that is shown after each second."""
        shown = []
        for number in range(STEPS):
            self.now_ns += 200_000_000
            if number == self.step_at:
                self.now_ns += self.step_ns
                if self.told:
                    self.monitor.move(self.step_ns)
                    self.state.move(self.step_ns)
            self._hear(number)
            if number % 5 == 4:
                self._note(number, self.monitor.tick(self.now_ns))
            if number % 5 == 4:
                shown.append(self._shown())
        return shown

    def _hear(self, number: int) -> None:
        header = Header(number, START_NS, self.now_ns, 0)
        estimate = estimate_of(percent_at(number), time_s=0.2 * number)
        values = dict.fromkeys(FEATURE_FIELDS, 1.0) | {"time_s": 0.2 * number}
        fault = Fault.GAP if number in (140, 300) else Fault.NONE
        values |= {"fault": fault, "sample_count": 3, "reversal_count": 1}
        block = FeatureBlock(**values)  # type: ignore[arg-type]
        self._note(number, self.monitor.on_preload(header, estimate, self.now_ns))
        self._note(number, self.monitor.on_feature(header, block, self.now_ns))
        if number < 480 and number % 20 == 5:
            report = ComponentHealth(component="acquire", axis="X", status=ComponentStatus.OK)
            self._note(number, self.monitor.on_component(report, self.now_ns))
            self.state.on_component(report, self.now_ns)
        if number == 100:
            shelve = Command(action="shelve", alarm=AlarmKind.RATE, user="Kim", duration_s=60.0)
            self._note(number, self.monitor.on_command(shelve, self.now_ns))
        self.state.on_preload("X", header, estimate, self.now_ns)
        self.state.on_feature("X", header, block)
        health = self.monitor.health(self.now_ns)
        if number % 5 == 0:
            self.state.on_health(Header(number, START_NS, self.now_ns, 0), health, self.now_ns)

    def _note(self, number: int, events: tuple[Event, ...]) -> None:
        self.events += [(number, event) for event in events]

    def _shown(self) -> dict[str, Any]:
        self.monitor.take_trend(self.monitor.trend_work()(), self.now_ns)
        reading = self.state.preload("X", self.now_ns)
        return {
            "health": self.monitor.health(self.now_ns).model_dump(by_alias=False),
            "state": self.state.health("X", self.now_ns).model_dump(by_alias=False),
            "live": [{"time_ns": each.time_ns} for each in self.state.live("X")],
            "age_s": reading.age_s,
            "measured_ns": reading.measured_time_ns,
            "unready": self.state.unready(self.now_ns),
        }


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from leaves(each, f"{path}.{key}")
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            yield from leaves(each, f"{path}.{index}")
    else:
        yield path, value


@pytest.fixture(scope="module")
def undisturbed() -> Run:
    """The run of a clock that nobody sets."""
    run = Run()
    run.shown = run.go()  # type: ignore[attr-defined]
    return run


@pytest.mark.parametrize("step_at", STEPS_AT)
@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_all_times_move_along_and_nothing_else_changes(
    undisturbed: Run, step_ns: int, step_at: int
) -> None:
    run, seconds = Run(step_ns, step_at), slice(step_at // 5 + 1, None)
    expected = undisturbed.shown  # type: ignore[attr-defined]
    for before, after in zip(expected[seconds], run.go()[seconds], strict=True):
        others = dict(leaves(after))
        for path, value in leaves(before):
            if re.search(r"headline\.(text|values\.time)$", path):
                continue  # names a time
            if path.endswith("_ns") and value:
                assert others[path] - value == pytest.approx(step_ns, abs=NS), path
            elif isinstance(value, float):
                assert others[path] == pytest.approx(value, rel=1e-3, abs=1e-3), path
            else:
                assert others[path] == value, path
    told = [(number, event.kind, event.text) for number, event in run.events]
    assert told == [(number, event.kind, event.text) for number, event in undisturbed.events]
    kinds = {event.kind for _, event in run.events}
    assert {"condition_changed", "data_fault", "alarm_raised", "status_changed"} <= kinds


@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_even_a_step_that_nobody_tells_freezes_no_trend(step_ns: int) -> None:
    run = Run(step_ns, told=False)
    run.go()
    time_s, percent, *_ = run.monitor.trend_work().args
    assert time_s[-1] == pytest.approx(run.now_ns / NS, abs=3.0)
    assert percent[-1] == pytest.approx(percent_at(STEPS - 1), abs=0.1)


@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_a_kept_state_of_another_clock_goes_on(step_ns: int) -> None:
    """Stopped, and begun again after the clock was set: the history ends before now."""
    run = Run()
    run.go()
    kept, begun_ns = run.monitor.snapshot(), run.now_ns + step_ns
    again = AxisMonitor(*FACTS, AlarmSettings(), begun_ns)
    again.restore(kept)
    old_s, old_percent, *_ = run.monitor.trend_work().args
    time_s, percent, *_ = again.trend_work().args
    assert time_s[-1] <= begun_ns / NS + 1.0
    assert (time_s - time_s[0]) == pytest.approx(old_s - old_s[0], abs=1e-3)
    assert percent == pytest.approx(old_percent, rel=1e-12)
    for alarm in again.health(begun_ns).alarms:
        assert alarm.raised_time_ns <= begun_ns
        assert (alarm.shelved_until_ns or 0) <= begun_ns + 60 * NS


@pytest.mark.parametrize("stop_s", [5, 3600, 40 * 86400])
@pytest.mark.parametrize("ahead_ns", [74 * 365 * DAY_NS, 30 * DAY_NS], ids=["2100", "a month"])
def test_a_start_with_a_clock_that_was_ahead_leaves_the_trend_where_it_is(
    stop_s: int, ahead_ns: int
) -> None:
    before = Run()
    before.go()
    kept = before.monitor.snapshot()
    begun_ns = before.now_ns + stop_s * NS

    def started(ahead_ns: int) -> AxisMonitor:
        monitor = AxisMonitor(*FACTS, AlarmSettings(), begun_ns + ahead_ns)
        monitor.restore(kept)
        for number in range(300):
            at_ns = begun_ns + number * NS + (ahead_ns if number < 150 else 0)
            if number == 150 and ahead_ns:
                monitor.move(-ahead_ns)
            monitor.tick(at_ns)
            estimate = estimate_of(2.0 - 0.001 * number, time_s=float(number))
            monitor.on_preload(Header(number, 1, at_ns, number), estimate, at_ns)
        return monitor

    right, wrong = started(0), started(ahead_ns)
    now_ns = begun_ns + 300 * NS
    assert wrong.health(now_ns).use == right.health(now_ns).use
    times = [each.snapshot()["series"] for each in (right, wrong)]
    points = [each._series.points() for each in (right, wrong)]
    assert points[0][0][0] == pytest.approx(points[1][0][0], abs=1.0)
    assert points[0][0][-1] == pytest.approx(points[1][0][-1], abs=times[0]["step_s"])
    assert (np.diff(points[1][0]) > 0.0).all()
    limits = {"warning": 1.0}
    trends = [preload_trend(*each, limits) for each in points]
    assert trends[0].status == trends[1].status
