"""The friction curve of an axis, with only the parts that its points show, and its changes.

The exponential form (Armstrong-Helouvry, 1991) stands for (5.3.12)-(5.3.15); the thesis fits it to
(speed, torque) points in its Figure 5.10. Changes from test to test are its warm-up study (5.11).
"""

import itertools
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.screw.friction import exponential_friction
from ...regression.interval_estimate import IntervalEstimate, around, normal_quantile, undetermined
from ...regression.nonlinear import Unknown, best_values, fit_profiled, unexplained_share
from ..result import Contents, Curve, mean_of, rounded_rpm
from .cruises import FrictionPoint

_LEAST_SPEEDS = 4
"""Level, excess, Stribeck speed and viscous part need as many speeds."""
STRIBECK_SIGMAS = 3.0
"""A rise shows by so many deviations: at the level of the intervals 1 axis in 40 would have one."""
NO_STRIBECK = "no rise of the friction at low speed is visible"
_FRICTION_LABELS = ("motor speed, rad/s", "friction torque, N m")
LEAST_ERROR_SHARE = 1e-3
"""Share of a torque by which a curve is off where too few points tell how true it is."""
_LEAST_SHARE = 1e-6
_REACH = 10.0
"""Speed scales are searched up to this factor beyond the slowest and the fastest point."""


def measure_friction(points: Sequence[FrictionPoint]) -> Contents:
    """Friction curve with its parts, over both directions and over each (5.3.12-5.3.15).

    Raises ValueError: too few speeds.
    """
    speeds = {rounded_rpm(point.speed_rad_s) for point in points}
    if len(speeds) < _LEAST_SPEEDS:
        raise ValueError(
            f"cruises at {len(speeds)} speeds; a friction curve needs {_LEAST_SPEEDS} or more"
        )
    whole = friction_parts(points)
    figures = dict(whole.parameters)
    signed = [point.speed_rad_s for point in points]
    half = np.geomspace(min(map(abs, signed)), max(map(abs, signed)), 60)
    speed = np.concatenate(
        (-half[::-1] if min(signed) < 0.0 else [], half if max(signed) > 0.0 else [])
    )
    drawn = {"fit": whole.torque_nm(speed), **whole.parts_nm(speed)}
    curves = [Curve(name, speed, torque, *_FRICTION_LABELS) for name, torque in drawn.items()]
    for name, way in (("forward", True), ("backward", False)):
        there = [point for point in points if point.forward is way]
        if there:
            ordered = sorted(there, key=lambda point: point.speed_rad_s)
            x = np.array([point.speed_rad_s for point in ordered])
            y = np.array([point.torque_nm for point in ordered])
            curves.append(Curve(name, x, y, *_FRICTION_LABELS))
        if len({rounded_rpm(point.speed_rad_s) for point in there}) >= _LEAST_SPEEDS:
            parts = friction_parts(there).parameters
            for part in ("coulomb_nm", "viscous_nm_s_per_rad"):
                figures[f"{name}_{part}"] = parts[part]
    levels = {f"level_{rpm}_rpm_nm": _mean_level(ways) for rpm, ways in _both_ways(points).items()}
    return figures | levels, curves


@dataclass(frozen=True, slots=True, eq=False)
class FrictionParts:
    parameters: Mapping[str, IntervalEstimate]  # with intervals
    # of the curve, by the same names; a part that is missing is not in it
    values: Mapping[str, float]

    def torque_nm(self, speed_rad_s: Floats) -> Floats:
        """The curve, N m, in the shape of `speed_rad_s`."""
        total: Floats = np.sum(list(self.parts_nm(speed_rad_s).values()), axis=0)
        return total

    def parts_nm(self, speed_rad_s: Floats) -> dict[str, Floats]:
        """Part -> torque, N m, in the shape of `speed_rad_s`: terms of the exponential form.

        The Coulomb part holds the offset, as (5.3.14) has it.
        """
        values = self.values
        coulomb_nm = values["coulomb_nm"] * np.sign(speed_rad_s) + values.get("offset_nm", 0.0)
        parts = {"Coulomb": coulomb_nm, "viscous": values["viscous_nm_s_per_rad"] * speed_rad_s}
        if excess_nm := values.get("stribeck_excess_nm", 0.0):
            scale_rad_s = values["stribeck_speed_rad_s"]
            parts["Stribeck"] = exponential_friction(speed_rad_s, 0.0, excess_nm, scale_rad_s)
        return parts


def friction_parts(points: Sequence[FrictionPoint]) -> FrictionParts:
    """Coulomb, viscous and offset; the Stribeck part only where the points show one.

    Without a visible rise its speed is arbitrary, and any Coulomb level could be had by it.
    """
    full = fit_friction(points)
    excess = full.parameters["stribeck_excess_nm"]
    if excess.determined:
        sigma_below = (excess.value - excess.low) / normal_quantile()
        if excess.value > STRIBECK_SIGMAS * sigma_below:
            return full
    speed = np.array([point.speed_rad_s for point in points])
    torque = np.array([point.torque_nm for point in points])
    error = np.array([point.standard_error_nm for point in points])
    weight = 1.0 / np.hypot(error, LEAST_ERROR_SHARE * np.abs(torque))
    both = bool((speed > 0.0).any() and (speed < 0.0).any())
    names = {"coulomb_nm": "N m", "viscous_nm_s_per_rad": "N m s/rad"}
    columns = [np.sign(speed), speed]
    if both:
        names["offset_nm"] = "N m"
        columns.append(np.ones_like(speed))
    design = np.column_stack(columns) * weight[:, None]
    inverse = np.linalg.pinv(design)
    found = inverse @ (torque * weight)
    freedom = max(len(points) - len(names), 1)
    chi2 = float(np.sum((torque * weight - design @ found) ** 2)) / freedom
    sigma = np.sqrt(np.diag(inverse @ inverse.T) * max(chi2, 1.0))
    count = float(len(points))
    parameters = {
        name: around(float(found[k]), float(sigma[k]), unit, count, len(names))
        for k, (name, unit) in enumerate(names.items())
    }
    parameters["stribeck_excess_nm"] = undetermined("N m", NO_STRIBECK, count)
    parameters["stribeck_speed_rad_s"] = undetermined("rad/s", NO_STRIBECK, count)
    return FrictionParts(parameters, dict(zip(names, found.tolist(), strict=True)))


def fit_friction(points: Sequence[FrictionPoint]) -> FrictionParts:
    """Fit one curve to all points, each with its own error and the scatter that no curve explains.

    With points in one direction only, the offset cannot be told from the Coulomb level and is
    left out as undetermined. Raises ValueError: fewer points than parameters.
    """
    speed = np.array([point.speed_rad_s for point in points])
    torque = np.array([point.torque_nm for point in points])
    error = np.array([point.standard_error_nm for point in points])
    if len(points) == 0:
        raise ValueError("no cruise at constant speed in the recording; run the friction test")
    error = np.hypot(error, _LEAST_SHARE * np.abs(torque))
    both = bool((speed > 0.0).any() and (speed < 0.0).any())
    slowest, fastest = float(np.min(np.abs(speed))), float(np.max(np.abs(speed)))
    peak, level = float(np.max(np.abs(torque))), float(np.median(np.abs(torque)))
    scales = slowest / _REACH, fastest * _REACH
    unknowns = [
        Unknown("coulomb_nm", 0.0, 2.0 * peak, "N m", floor=0.0),
        Unknown("stribeck_excess_nm", 0.0, 10.0 * peak, "N m", floor=0.0),
        Unknown("stribeck_speed_rad_s", *scales, "rad/s", logarithmic=True),
        Unknown("viscous_nm_s_per_rad", 0.0, 2.0 * peak / slowest, "N m s/rad", floor=0.0),
    ]
    if both:
        unknowns.append(Unknown("offset_nm", -2.0 * peak, 2.0 * peak, "N m"))
    names = [unknown.name for unknown in unknowns]
    starts = [
        np.array([level, 0.2 * level, scale, 0.0, 0.0][: len(unknowns)])
        for scale in np.geomspace(*scales, 7)[1:-1].tolist()
    ]

    def misfit_nm(values: Floats) -> Floats:
        named = dict(zip(names, values.tolist(), strict=True))
        level, excess = named["coulomb_nm"], named["stribeck_excess_nm"]
        scale, viscous = named["stribeck_speed_rad_s"], named["viscous_nm_s_per_rad"]
        friction = exponential_friction(speed, level, level + excess, scale, viscous)
        torque_nm = np.asarray(friction + named.get("offset_nm", 0.0), dtype=np.float64)
        return np.asarray(torque_nm - torque, dtype=np.float64)

    first = best_values(lambda values: misfit_nm(values) / error, unknowns, starts)
    share = unexplained_share(misfit_nm(first), error, np.abs(torque), len(unknowns))
    error = np.hypot(error, share * np.abs(torque))
    fit = fit_profiled(lambda values: misfit_nm(values) / error, unknowns, [first, *starts])
    parameters = dict(fit.parameters)
    values = dict(zip(names, fit.values.tolist(), strict=True))
    if not both:
        parameters["offset_nm"] = undetermined(
            "N m", "one direction only: cannot be told from coulomb_nm", float(len(points))
        )
    return FrictionParts(parameters, values)


def _both_ways(points: Sequence[FrictionPoint]) -> dict[str, dict[bool, list[FrictionPoint]]]:
    """Speed, rpm -> forward or not -> points in time order, of speeds run in both directions."""
    groups: dict[str, dict[bool, list[FrictionPoint]]] = defaultdict(lambda: defaultdict(list))
    for point in sorted(points, key=lambda point: point.time_s):
        groups[rounded_rpm(point.speed_rad_s)][point.forward].append(point)
    return {rpm: groups[rpm] for rpm in sorted(groups, key=float) if len(groups[rpm]) == 2}


def _mean_level(ways: Mapping[bool, Sequence[FrictionPoint]]) -> IntervalEstimate:
    """Mean magnitude of the friction at one speed, of points in both directions, N m."""
    return _mean_of_ways([_mean_torque(points) for points in ways.values()])


def _mean_torque(points: Sequence[FrictionPoint]) -> IntervalEstimate:
    errors_nm = [point.standard_error_nm for point in points]
    return mean_of([abs(point.torque_nm) for point in points], errors_nm, "N m")


def _mean_of_ways(ways: Sequence[IntervalEstimate]) -> IntervalEstimate:
    value = sum(way.value for way in ways) / len(ways)
    half = math.hypot(*(way.high - way.value for way in ways)) / len(ways)
    count = min(way.n_effective for way in ways)
    return IntervalEstimate(value, value - half, value + half, "N m", count)


@dataclass(frozen=True, slots=True, eq=False)
class FrictionTest:
    name: str  # of its recording
    # start_s, end_s: of its cruises, s
    start_s: float
    end_s: float
    # rpm -> forward or not -> points in time order
    speeds: Mapping[str, Mapping[bool, Sequence[FrictionPoint]]]


def measure_friction_runs(recordings: Mapping[str, Sequence[FrictionPoint]]) -> Contents:
    """Friction of each test over speed, and its change from the first test to the last.

    Figures: the change at the middle one of the speeds that all tests share, then at each, then
    the level of each test at the middle one. Curves: one for each test, in their order.

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
        figures[f"change_at_{rpm}_rpm_nm"] = _mean_of_ways(ways)
    curves = []
    for number, test in enumerate(tests, start=1):
        figures[f"run_{number}_level_{middle}_rpm_nm"] = _mean_level(test.speeds[middle])
        there = [[each for way in test.speeds[rpm].values() for each in way] for rpm in shared]
        speeds = [np.mean([abs(point.speed_rad_s) for point in points]) for points in there]
        levels = [_mean_level(test.speeds[rpm]).value for rpm in shared]
        curves.append(Curve(test.name, np.array(speeds), np.array(levels), *_FRICTION_LABELS))
    return figures, curves


def friction_tests(recordings: Mapping[str, Sequence[FrictionPoint]]) -> list[FrictionTest]:
    """Recordings that run enough speeds in both directions, in their order.

    That is the order of their clocks where one test ends before the next begins. Clocks that
    overlap were set anew for each recording, and the names count.
    """
    found = []
    for name in sorted(recordings):
        points = recordings[name]
        speeds = _both_ways(points)
        if len(speeds) >= _LEAST_SPEEDS:
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
        errors_nm = [float(np.hypot(a.standard_error_nm, b.standard_error_nm)) for a, b in pairs]
        return mean_of([abs(b.torque_nm) - abs(a.torque_nm) for a, b in pairs], errors_nm, "N m")
    before, after = _mean_torque(first), _mean_torque(last)
    value = after.value - before.value
    half = float(np.hypot(before.high - before.value, after.high - after.value))
    count = min(before.n_effective, after.n_effective)
    return IntervalEstimate(value, value - half, value + half, "N m", count)
