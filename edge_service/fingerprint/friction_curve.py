"""The friction curve of an axis with only the parts that its points show."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.samples import Floats
from .friction_fit import LEAST_ERROR_SHARE, fit_friction
from .friction_points import FrictionPoint, friction_points
from .identified import Identified, around, undetermined
from .preparation import PreparedRun
from .section import Contents, Curve, mean_of, rounded_rpm

LEAST_SPEEDS = 4
"""Level, excess, Stribeck speed and viscous part need as many speeds."""
NO_STRIBECK = "no rise of the friction at low speed is visible"
_LABELS = ("motor speed, rad/s", "friction torque, N m")


def measure_friction(runs: Iterable[PreparedRun], inertia_kg_m2: float) -> Contents:
    """Friction curve with its parts, over both directions and over each (5.3.12-5.3.15).

    Raises:
        ValueError: one line; too few speeds.
    """
    points = list(friction_points(runs, inertia_kg_m2=inertia_kg_m2))
    speeds = {rounded_rpm(point.speed_rad_s) for point in points}
    if len(speeds) < LEAST_SPEEDS:
        raise ValueError(
            f"cruises at {len(speeds)} speeds; a friction curve needs {LEAST_SPEEDS} or more"
        )
    whole = friction_parts(points)
    figures = dict(whole.parameters)
    curves = [_fitted(whole, points)]
    for name, way in (("forward", True), ("backward", False)):
        there = [point for point in points if point.forward is way]
        if there:
            curves.append(_point_curve(name, there))
        if len({rounded_rpm(point.speed_rad_s) for point in there}) >= LEAST_SPEEDS:
            parts = friction_parts(there).parameters
            for part in ("coulomb_nm", "viscous_nm_s_per_rad"):
                figures[f"{name}_{part}"] = parts[part]
    return figures | _levels(points), curves


@dataclass(frozen=True, slots=True, eq=False)
class FrictionParts:
    """Parts of a friction curve; `torque_nm` maps motor speeds, rad/s, to the curve, N m."""

    parameters: Mapping[str, Identified]
    torque_nm: Callable[[Floats], Floats]


def friction_parts(points: Sequence[FrictionPoint]) -> FrictionParts:
    """Coulomb, viscous and offset; the Stribeck part only where the points show one.

    Without a visible rise its speed is arbitrary, and any Coulomb level could be had by it.
    """
    full = fit_friction(points)
    excess = full.parameters["stribeck_excess_nm"]
    if excess.determined and excess.low > 0.0:
        return FrictionParts(full.parameters, full.torque_nm)
    return _straight(points)


def _straight(points: Sequence[FrictionPoint]) -> FrictionParts:
    """Weighted least squares of F_c sgn(v) + D v + f_offset, the scatter making the intervals."""
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
    coulomb_nm, viscous = float(found[0]), float(found[1])
    offset_nm = float(found[2]) if both else 0.0
    return FrictionParts(parameters, lambda v: coulomb_nm * np.sign(v) + viscous * v + offset_nm)


def _levels(points: Sequence[FrictionPoint]) -> dict[str, Identified]:
    """Friction at each speed, the mean of both directions where both are there, N m."""
    groups: dict[str, dict[bool, list[FrictionPoint]]] = defaultdict(lambda: defaultdict(list))
    for point in points:
        groups[rounded_rpm(point.speed_rad_s)][point.forward].append(point)
    levels = {}
    for rpm in sorted(groups, key=float):
        ways = [
            mean_of(
                [abs(point.torque_nm) for point in there],
                [point.standard_error_nm for point in there],
                "N m",
            )
            for there in groups[rpm].values()
        ]
        if len(ways) == 2:
            value = 0.5 * (ways[0].value + ways[1].value)
            half = 0.5 * math.hypot(*(way.high - way.value for way in ways))
            count = min(way.n_effective for way in ways)
            levels[f"level_{rpm}_rpm_nm"] = Identified(
                value, value - half, value + half, "N m", count
            )
    return levels


def _point_curve(name: str, points: Sequence[FrictionPoint]) -> Curve:
    ordered = sorted(points, key=lambda point: point.speed_rad_s)
    return Curve(
        name,
        np.array([point.speed_rad_s for point in ordered]),
        np.array([point.torque_nm for point in ordered]),
        *_LABELS,
    )


def _fitted(parts: FrictionParts, points: Sequence[FrictionPoint]) -> Curve:
    speeds = [point.speed_rad_s for point in points]
    half = np.geomspace(min(map(abs, speeds)), max(map(abs, speeds)), 60)
    speed = np.concatenate(
        (-half[::-1] if min(speeds) < 0.0 else [], half if max(speeds) > 0.0 else [])
    )
    return Curve("fit", speed, parts.torque_nm(speed), *_LABELS)
