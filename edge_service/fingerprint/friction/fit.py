"""Nonlinear friction fit to (speed, torque) points (thesis, Figure 5.10).

The exponential form (Armstrong-Helouvry, 1991) stands for (5.3.12)-(5.3.15).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.screw.friction import exponential_friction
from ...regression.interval_estimate import IntervalEstimate, undetermined
from ...regression.nonlinear import Unknown, best_values, fit_profiled, unexplained_share
from .points import FrictionPoint

LEAST_ERROR_SHARE = 1e-3
"""Share of a torque by which a curve is off where too few points tell how true it is."""
_LEAST_SHARE = 1e-6
_REACH = 10.0
"""Speed scales are searched up to this factor beyond the slowest and the fastest point."""


@dataclass(frozen=True, slots=True, eq=False)
class FrictionFit:
    """Friction of the axis at the motor.

    Attributes:
        parameters: coulomb_nm (F_c), stribeck_excess_nm (F_brk - F_c), stribeck_speed_rad_s
            (v_st), viscous_nm_s_per_rad (D), offset_nm (f_offset).
        values: the best fit itself, by the same names, determined or not.
        reduced_chi2: 1 where the points scatter as their errors say. What they scatter beyond their
            standard errors counts as error.
    """

    parameters: Mapping[str, IntervalEstimate]
    values: Mapping[str, float]
    reduced_chi2: float

    def torque_nm(self, speed_rad_s: Floats) -> Floats:
        """The fitted curve, N m, in the shape of `speed_rad_s`."""
        return _torque_nm(self.values, speed_rad_s)


def fit_friction(points: Sequence[FrictionPoint]) -> FrictionFit:
    """Fit one curve to all points, each with its own error and the scatter that no curve explains.

    With points in one direction only, the offset cannot be told from the Coulomb level and is left
    out as undetermined.

    Raises:
        ValueError: fewer points than parameters.
    """
    speed = np.array([point.speed_rad_s for point in points])
    torque = np.array([point.torque_nm for point in points])
    error = np.array([point.standard_error_nm for point in points])
    if len(points) == 0:
        raise ValueError("no cruise at constant speed in the recording; run the friction test")
    error = np.hypot(error, _LEAST_SHARE * np.abs(torque))
    both = bool((speed > 0.0).any() and (speed < 0.0).any())
    unknowns = _unknowns(speed, torque, both)
    names = [unknown.name for unknown in unknowns]

    def misfit_nm(values: Floats) -> Floats:
        named = dict(zip(names, values.tolist(), strict=True))
        return np.asarray(_torque_nm(named, speed) - torque, dtype=np.float64)

    starts = _starts(unknowns, torque)
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
    return FrictionFit(parameters, values, fit.reduced_chi2)


def _torque_nm(values: Mapping[str, float], speed_rad_s: Floats) -> Floats:
    """Friction torque; the force equations hold for torque and speed at the motor as they are."""
    coulomb = values["coulomb_nm"]
    friction = exponential_friction(
        speed_rad_s,
        coulomb,
        coulomb + values["stribeck_excess_nm"],
        values["stribeck_speed_rad_s"],
        values["viscous_nm_s_per_rad"],
    )
    return np.asarray(friction + values.get("offset_nm", 0.0), dtype=np.float64)


def _unknowns(speed_rad_s: Floats, torque_nm: Floats, both: bool) -> list[Unknown]:
    slowest, fastest = float(np.min(np.abs(speed_rad_s))), float(np.max(np.abs(speed_rad_s)))
    peak = float(np.max(np.abs(torque_nm)))
    speeds = (slowest / _REACH, fastest * _REACH)
    unknowns = [
        Unknown("coulomb_nm", 0.0, 2.0 * peak, "N m", floor=0.0),
        Unknown("stribeck_excess_nm", 0.0, 10.0 * peak, "N m", floor=0.0),
        Unknown("stribeck_speed_rad_s", *speeds, "rad/s", logarithmic=True),
        Unknown("viscous_nm_s_per_rad", 0.0, 2.0 * peak / slowest, "N m s/rad", floor=0.0),
    ]
    if both:
        unknowns.append(Unknown("offset_nm", -2.0 * peak, 2.0 * peak, "N m"))
    return unknowns


def _starts(unknowns: Sequence[Unknown], torque_nm: Floats) -> list[Floats]:
    """A grid over the speed scales; levels from the torque."""
    level = float(np.median(np.abs(torque_nm)))
    plain = {"coulomb_nm": level, "stribeck_excess_nm": 0.2 * level}
    grids = [
        np.geomspace(unknown.low, unknown.high, 7)[1:-1].tolist()
        if unknown.logarithmic
        else [plain.get(unknown.name, 0.0)]
        for unknown in unknowns
    ]
    return [np.array(start) for start in itertools.product(*grids)]
