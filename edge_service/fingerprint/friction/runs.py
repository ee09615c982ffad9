"""Changes from friction test to friction test: the thesis' warm-up study (Figure 5.11)."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...regression.interval_estimate import IntervalEstimate
from ..result import Contents, Curve, mean_of
from .curve import (
    FRICTION_LABELS,
    LEAST_SPEEDS,
    both_ways,
    mean_level,
    mean_of_ways,
    mean_torque,
)
from .points import FrictionPoint

Ways = Mapping[bool, Sequence[FrictionPoint]]


@dataclass(frozen=True, slots=True, eq=False)
class FrictionTest:
    """One friction test.

    Attributes:
        name: of its recording.
        start_s, end_s: of its cruises, s.
        speeds: rpm -> forward or not -> points in time order.
    """

    name: str
    start_s: float
    end_s: float
    speeds: Mapping[str, Ways]


def measure_friction_runs(recordings: Mapping[str, Sequence[FrictionPoint]]) -> Contents:
    """Friction of each test over speed, and its change from the first test to the last.

    Figures: the change at the middle one of the speeds that all tests share, then at each, then
    the level of each test at the middle one. Curves: one for each test, in their order.

    Args:
        recordings: points by the name of their recording.

    Raises ValueError: fewer than two friction tests, or none of their speeds is shared.
    """
    tests = friction_tests(recordings)
    if len(tests) < 2:
        raise ValueError(f"{len(tests)} recordings hold a friction test; a change needs 2 or more")
    shared = sorted(set.intersection(*(set(test.speeds) for test in tests)), key=float)
    if not shared:
        raise ValueError("the friction tests have no speed in common")
    middle = shared[len(shared) // 2]
    first, last = tests[0].speeds, tests[-1].speeds
    figures = {}
    for rpm in (middle, *(each for each in shared if each != middle)):
        ways = [_change(first[rpm][way], last[rpm][way]) for way in (True, False)]
        figures[f"change_at_{rpm}_rpm_nm"] = mean_of_ways(ways)
    curves = []
    for number, test in enumerate(tests, start=1):
        figures[f"run_{number}_level_{middle}_rpm_nm"] = mean_level(test.speeds[middle])
        speeds = [
            np.mean([abs(point.speed_rad_s) for way in test.speeds[rpm].values() for point in way])
            for rpm in shared
        ]
        levels = [mean_level(test.speeds[rpm]).value for rpm in shared]
        curves.append(Curve(test.name, np.array(speeds), np.array(levels), *FRICTION_LABELS))
    return figures, curves


def friction_tests(recordings: Mapping[str, Sequence[FrictionPoint]]) -> list[FrictionTest]:
    """Recordings that run enough speeds in both directions, in their order.

    That is the order of their clocks where one test ends before the next begins. Clocks that
    overlap were set anew for each recording, and the names count.
    """
    found = []
    for name in sorted(recordings):
        points = recordings[name]
        speeds = both_ways(points)
        if len(speeds) >= LEAST_SPEEDS:
            times_s = [point.time_s for point in points]
            found.append(FrictionTest(name, min(times_s), max(times_s), speeds))
    by_clock = sorted(found, key=lambda test: test.start_s)
    one_clock = all(a.end_s < b.start_s for a, b in itertools.pairwise(by_clock))
    return by_clock if one_clock else found


def _change(first: Sequence[FrictionPoint], last: Sequence[FrictionPoint]) -> IntervalEstimate:
    """Friction at one speed, one way, in the last test less that in the first, N m.

    Repeats of one test pair off, each at its place on the stroke: what varies along the stroke is
    in both, and leaves the difference alone.
    """
    if len(first) == len(last):
        pairs = list(zip(first, last, strict=True))
        return mean_of(
            [abs(b.torque_nm) - abs(a.torque_nm) for a, b in pairs],
            [float(np.hypot(a.standard_error_nm, b.standard_error_nm)) for a, b in pairs],
            "N m",
        )
    before, after = mean_torque(first), mean_torque(last)
    value = after.value - before.value
    half = float(np.hypot(before.high - before.value, after.high - after.value))
    count = min(before.n_effective, after.n_effective)
    return IntervalEstimate(value, value - half, value + half, "N m", count)
