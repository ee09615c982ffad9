"""Torque balance identified on a healthy axis: friction and inertia (thesis, eq. 4.3.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ...models.screw.friction import stribeck_decay
from ...models.steady_limits import SteadyLimits
from .move_friction import move_scatter_nm
from .robust_regression import Noise, RegressionFit, robust_regression
from .steady_phases import CommissioningError, SteadyPhases, require_motion

STRIBECK_SHARES = (0.25, 0.5, 1.0, 1.5, 2.5, 4.0)
"""Candidates of the Stribeck speed, over the slowest steady motion."""
STROKE_HARMONICS = 3


@dataclass(frozen=True, slots=True)
class TorqueBalance:
    """Parameters of the torque balance; see mixture.physics for the equation.

    Attributes:
        unexplained: rms of the residual over that of the torque around its mean.
        move_scatter_nm: standard deviation of friction from move to move.
    """

    inertia_kg_m2: float
    inertia_sigma: float
    viscous_nm_s_per_rad: float
    viscous_sigma: float
    asymmetry_nm_s_per_rad: float
    coulomb_nm: float
    coulomb_sigma: float
    offset_nm: float
    stribeck_nm: float
    stribeck_speed_rad_s: float
    harmonics_nm: Floats  # (k, 2)
    noise: Noise
    unexplained: float
    move_scatter_nm: float
    motion_s: float


def fit_torque_balance(
    phases: SteadyPhases, machine: Machine, limits: SteadyLimits
) -> TorqueBalance:
    """Fit the torque balance.

    Raises:
        CommissioningError: motion is missing.
    """
    require_motion(phases, limits)
    speeds = [share * limits.slowest_rad_s for share in STRIBECK_SHARES]
    stroke_m = machine.axis.stroke_m or 1.0
    speed, fit = _likeliest(phases, speeds, _harmonics(phases, machine), stroke_m)
    v, s = fit.value, fit.sigma
    if v[0] <= 0.0 or v[3] <= 0.0:
        raise CommissioningError(
            "torque and motion contradict each other "
            f"(inertia {v[0]:.3g} kg m2, friction {v[3]:.3g} N m): check signs and units"
        )
    significant = v[5] > 2.0 * s[5]
    return TorqueBalance(
        inertia_kg_m2=float(v[0]),
        inertia_sigma=float(s[0]),
        viscous_nm_s_per_rad=max(float(v[1]), 0.0),
        viscous_sigma=float(s[1]),
        asymmetry_nm_s_per_rad=float(v[2]),
        coulomb_nm=float(v[3]),
        coulomb_sigma=float(s[3]),
        offset_nm=float(v[4]),
        stribeck_nm=float(v[5]) if significant else 0.0,
        stribeck_speed_rad_s=speed,
        harmonics_nm=v[6:].reshape(-1, 2),
        noise=fit.noise,
        unexplained=_unexplained(fit, phases),
        move_scatter_nm=move_scatter_nm(phases, fit.residual),
        motion_s=float(phases.steady_s.sum()),
    )


def _unexplained(fit: RegressionFit, phases: SteadyPhases) -> float:
    around = phases.torque_nm - np.average(phases.torque_nm, weights=phases.steady_s)
    whole = np.average(around**2, weights=phases.steady_s)
    left = np.average(fit.residual**2, weights=phases.steady_s)
    return float(np.sqrt(left / whole)) if whole > 0.0 else 1.0


def _harmonics(phases: SteadyPhases, machine: Machine) -> int:
    """Number of harmonics along the stroke that the recording can resolve."""
    stroke = machine.axis.stroke_m
    mapped = stroke is not None and not np.isnan(phases.table_m).any()
    spread = float(np.ptp(phases.table_m)) if mapped else 0.0
    return STROKE_HARMONICS if stroke and spread > 0.6 * stroke else 0


def _likeliest(
    phases: SteadyPhases, speeds: Sequence[float], harmonics: int, stroke_m: float
) -> tuple[float, RegressionFit]:
    """The Stribeck speed that fits best, and its fit."""
    level = float(np.median(np.abs(phases.torque_nm)))
    fits = []
    for speed in speeds:
        columns, sigma = _torque_columns(phases, speed, harmonics, stroke_m, level)
        fits.append((speed, robust_regression(columns, phases.torque_nm, phases, sigma)))
    return min(fits, key=lambda each: _cost(each[1], phases))


def _cost(fit: RegressionFit, phases: SteadyPhases) -> float:
    variance = fit.noise.variance(phases.steady_s, phases.speed_rad_s)
    return float(np.sum(np.log(variance) + np.minimum(fit.residual**2 / variance, 9.0)))


def _torque_columns(
    phases: SteadyPhases, stribeck_speed: float, harmonics: int, stroke_m: float, level: float
) -> tuple[Floats, Floats]:
    s, v = phases.direction, phases.speed_rad_s
    columns = [
        phases.acceleration_rad_s2,
        v,
        np.abs(v),
        s,
        np.ones_like(v),
        s * stribeck_decay(v, stribeck_speed),
    ]
    fastest = max(float(np.abs(v).max()), 1.0)
    sigma = [np.inf, np.inf, 0.2 * level / fastest, np.inf, np.inf, 0.5 * level]
    for k in range(1, harmonics + 1):
        phase = 2.0 * np.pi * k * phases.table_m / stroke_m
        columns += [s * np.cos(phase), s * np.sin(phase)]
        sigma += [0.1 * level, 0.1 * level]
    return np.column_stack(columns), np.array(sigma)
