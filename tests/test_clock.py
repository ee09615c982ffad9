"""The service's clock: slewed at once, set after a while, never wrong for some seconds."""

import re
from dataclasses import dataclass, field

import pytest

from edge_service.clock import HOLD_S, NS_PER_S, ServiceClock

from .documents import ROOT

START_NS = 1_795_000_000 * NS_PER_S
YEAR_NS = 365 * 86400 * NS_PER_S
STEPS_NS = [
    *(74 * YEAR_NS, -56 * YEAR_NS, 3600 * NS_PER_S, -7200 * NS_PER_S, 2 * NS_PER_S, -2 * NS_PER_S)
]


@dataclass
class Scene:
    """A clock whose hands the test moves."""

    wall_ns: int = START_NS
    steady_ns: int = 5
    told: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clock = ServiceClock(lambda: self.wall_ns, lambda: self.steady_ns)

    def run(self, seconds: float, *, slew: float = 0.0) -> list[int]:
        """Let time pass, with a look a second; what the clock says each time."""
        said = []
        with self.clock.telling(self.told.append):
            for _ in range(round(seconds)):
                self.steady_ns += NS_PER_S
                self.wall_ns += round((1.0 + slew) * NS_PER_S)
                before_ns = self.clock.now_ns()
                self.clock.follow()
                said += [before_ns, self.clock.now_ns()]
        return said


@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_a_step_of_some_seconds_is_never_seen(step_ns: int) -> None:
    scene = Scene()
    scene.run(10)
    scene.wall_ns += step_ns
    during = scene.run(HOLD_S - 5.0)
    scene.wall_ns -= step_ns
    said = [*during, *scene.run(100)]
    assert scene.told == []
    assert said == sorted(said)
    assert said[-1] == scene.wall_ns


@pytest.mark.parametrize("step_ns", STEPS_NS)
def test_a_step_that_lasts_is_followed_and_told_once(step_ns: int) -> None:
    scene = Scene()
    scene.run(10)
    scene.wall_ns += step_ns
    scene.run(HOLD_S + 5.0)
    assert (scene.told, scene.clock.now_ns()) == ([step_ns], scene.wall_ns)


def test_a_slewed_clock_is_followed_and_never_goes_back() -> None:
    for slew in (5e-4, -5e-4, 0.1, -0.1):
        scene = Scene()
        said = scene.run(600, slew=slew)
        assert said == sorted(said)
        assert abs(said[-1] - scene.wall_ns) <= abs(slew) * NS_PER_S
        assert scene.told == []


def test_a_wall_clock_that_never_rests_is_not_followed() -> None:
    scene = Scene()
    for number in range(100):
        scene.wall_ns += (-1) ** number * 3600 * NS_PER_S
        scene.run(1)
    assert scene.told == []
    assert scene.clock.now_ns() == START_NS + 100 * NS_PER_S


def test_a_suspended_host_makes_no_step() -> None:
    scene = Scene()
    scene.run(10)
    scene.steady_ns += 8 * 3600 * NS_PER_S
    scene.wall_ns += 8 * 3600 * NS_PER_S
    scene.run(100)
    assert (scene.told, scene.clock.now_ns()) == ([], scene.wall_ns)


def test_the_time_of_day_is_asked_for_in_one_place() -> None:
    asks = re.compile(r"time\.time(_ns)?\(|datetime\.(now|today|utcnow)|import .*\btime_ns\b")
    rooms = ("bus", "health", "http_api", "nodes", "estimate", "downsample")
    paths = [path for room in rooms for path in (ROOT / "edge_service" / room).rglob("*.py")]
    asking = {path.name for path in paths if asks.search(path.read_text("utf-8"))}
    assert asking <= {"store.py"}  # names a damaged file after the day
