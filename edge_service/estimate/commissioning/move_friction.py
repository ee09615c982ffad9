"""Friction of each move for itself: on a healthy axis that cuts nothing all of them have the same.

A force that acts in some of the moves bends friction, viscous friction and Stribeck excess of the
common fit until little is left over. Inside one move it cannot: there only speed and acceleration
change.
"""

import numpy as np

from ...messages.samples import Floats
from .steady_phases import SteadyPhases

PAUSE_S = 0.15
"""Blocks further apart belong to two moves."""
SHORTEST_S = 0.2
"""Steady motion of a move that says something of its own."""


def move_scatter_nm(phases: SteadyPhases, residual_nm: Floats) -> float:
    """Standard deviation of friction from move to move, without that of the noise.

    By regression within groups (Mundlak 1978).

    Args:
        phases: n of them.
        residual_nm: what the common fit leaves of the torque, (n,).
    """
    move, weight = _moves(phases), phases.steady_s
    steady_s = np.bincount(move, weight)
    motion = np.column_stack([phases.acceleration_rad_s2, phases.speed_rad_s])
    mean = np.column_stack([_means(column, move, weight) for column in motion.T])
    level = _means(residual_nm, move, weight)
    root = np.sqrt(weight)[:, None]
    design = (motion - mean[move]) * root
    left = (residual_nm - level[move]) * root[:, 0]
    covariance = np.linalg.pinv(design.T @ design, hermitian=True)
    change = covariance @ (design.T @ left)
    variance = np.sum((left - design @ change) ** 2) / max(len(move) - len(level), 1)
    doubt = variance * (1.0 / steady_s + np.einsum("ij,jk,ik->i", mean, covariance, mean))
    judged = (steady_s >= SHORTEST_S) & np.isfinite(doubt)
    if judged.sum() < 3:
        return 0.0
    direction = _means(phases.direction, move, weight)
    friction = (direction * (level - mean @ change))[judged]
    spread = np.var(friction) - np.mean(doubt[judged])
    return float(np.sqrt(max(spread, 0.0)))


def _moves(phases: SteadyPhases) -> np.ndarray:
    """Number of the move of each row: unbroken, in one direction, (n,)."""
    begins = np.abs(np.diff(phases.time_s)) > PAUSE_S
    begins |= np.diff(phases.direction) != 0.0
    begins |= np.diff(phases.run) != 0.0
    return np.concatenate([[0], np.cumsum(begins)])


def _means(values: Floats, group: np.ndarray, weight: Floats) -> Floats:
    """Weighted mean of each group, (k,)."""
    return np.asarray(np.bincount(group, weight * values) / np.bincount(group, weight))
