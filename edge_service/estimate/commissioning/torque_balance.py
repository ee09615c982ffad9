"""Torque balance identified on a healthy axis: friction and inertia (thesis, eq. 4.3.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ...models.screw.friction import stribeck_decay
from ...models.steady_limits import SteadyLimits
from .phases import (
    CommissioningError,
    Noise,
    RegressionFit,
    SteadyPhases,
    noise_of,
    place_columns,
    require_motion,
    robust_regression,
)

STRIBECK_SHARES = (0.25, 0.5, 1.0, 1.5, 2.5, 4.0)
"""Candidates of the Stribeck speed, over the slowest steady motion."""
STROKE_HARMONICS = 3
PAUSE_S = 0.15
"""Blocks further apart belong to two moves."""
SHORTEST_S = 0.2
"""Steady motion of a move that says something of its own."""


@dataclass(frozen=True, slots=True)
class TorqueBalance:
    """Parameters of the torque balance; see mixture.physics for the equation."""

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
    unexplained: float  # rms of the residual over that of the torque around its mean
    move_scatter_nm: float  # standard deviation of friction from move to move
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
    stroke_m, has_table = machine.axis.stroke_m, not np.isnan(phases.table_m).any()
    resolved = stroke_m and has_table and float(np.ptp(phases.table_m)) > 0.6 * stroke_m
    harmonics = STROKE_HARMONICS if resolved else 0
    speed, fit = _likeliest(phases, speeds, harmonics, stroke_m or 1.0)
    v, s = fit.value, fit.sigma
    if v[0] <= 0.0 or v[3] <= 0.0:
        raise CommissioningError(
            "torque and motion contradict each other "
            f"(inertia {v[0]:.3g} kg m2, friction {v[3]:.3g} N m): check signs and units"
        )
    significant = v[5] > 2.0 * s[5]
    odd = 6 + 2 * harmonics
    of_place_nm = place_columns(phases) @ v[odd:]
    weights = phases.steady_s
    around = phases.torque_nm - np.average(phases.torque_nm, weights=weights)
    whole, left = (np.average(each**2, weights=weights) for each in (around, fit.residual))
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
        harmonics_nm=v[6:odd].reshape(-1, 2),
        noise=noise_of(fit.residual + of_place_nm, phases),  # the estimator has no such torque
        unexplained=float(np.sqrt(left / whole)) if whole > 0.0 else 1.0,
        move_scatter_nm=move_scatter_nm(phases, fit.residual),
        motion_s=float(phases.steady_s.sum()),
    )


def _likeliest(
    phases: SteadyPhases, speeds: Sequence[float], harmonics: int, stroke_m: float
) -> tuple[float, RegressionFit]:
    """The Stribeck speed that fits best, and its fit."""
    level = float(np.median(np.abs(phases.torque_nm)))
    fits, costs = [], []
    for speed in speeds:
        columns, sigma = _torque_columns(phases, speed, harmonics, stroke_m, level)
        fit = robust_regression(columns, phases.torque_nm, phases, sigma)
        variance = fit.noise.variance(phases.steady_s, phases.speed_rad_s)
        costs.append(np.sum(np.log(variance) + np.minimum(fit.residual**2 / variance, 9.0)))
        fits.append((speed, fit))
    return fits[int(np.argmin(costs))]


def _torque_columns(
    phases: SteadyPhases, stribeck_speed: float, harmonics: int, stroke_m: float, level: float
) -> tuple[Floats, Floats]:
    s, v = phases.direction, phases.speed_rad_s
    columns = [phases.acceleration_rad_s2, v, np.abs(v), s, np.ones_like(v)]
    columns.append(s * stribeck_decay(v, stribeck_speed))
    fastest = max(float(np.abs(v).max()), 1.0)
    sigma = [np.inf, np.inf, 0.2 * level / fastest, np.inf, np.inf, 0.5 * level]
    for k in range(1, harmonics + 1):
        phase = 2.0 * np.pi * k * phases.table_m / stroke_m
        columns += [s * np.cos(phase), s * np.sin(phase)]
        sigma += [0.1 * level, 0.1 * level]
    place = place_columns(phases)
    return np.column_stack([*columns, place]), np.array(sigma + place.shape[1] * [0.5 * level])


def move_scatter_nm(phases: SteadyPhases, residual_nm: Floats) -> float:
    """Standard deviation of friction from move to move, without that of the noise.

    A healthy axis that cuts nothing has the same friction in all moves. A force that acts in some
    of them bends friction, viscous friction and Stribeck excess of the common fit until little is
    left over; inside one move it cannot, where only speed and acceleration change. By regression
    within groups (Mundlak 1978) of what the common fit leaves of the torque, (n,): on speed alone,
    for a start and its stop leave nothing of an acceleration, and noisy ones bend the slope.
    """
    begins = np.abs(np.diff(phases.time_s)) > PAUSE_S
    begins |= (np.diff(phases.direction) != 0.0) | (np.diff(phases.run) != 0.0)
    move, weight = np.concatenate([[0], np.cumsum(begins)]), phases.steady_s
    steady_s, speed = np.bincount(move, weight), phases.speed_rad_s
    mean, level = (_means(each, move, weight) for each in (speed, residual_nm))
    inside, left = speed - mean[move], residual_nm - level[move]
    moment = float(np.sum(weight * inside**2)) or np.inf
    slope = float(np.sum(weight * inside * left)) / moment
    variance = np.sum(weight * (left - slope * inside) ** 2) / max(len(move) - len(level), 1)
    doubt = variance * (1.0 / steady_s + mean**2 / moment)
    judged = steady_s >= SHORTEST_S
    if judged.sum() < 3:
        return 0.0
    friction = (_means(phases.direction, move, weight) * (level - slope * mean))[judged]
    return float(np.sqrt(max(np.var(friction) - np.mean(doubt[judged]), 0.0)))


def _means(values: Floats, group: np.ndarray, weight: Floats) -> Floats:
    """Weighted mean of each group, (k,)."""
    return np.asarray(np.bincount(group, weight * values) / np.bincount(group, weight))
