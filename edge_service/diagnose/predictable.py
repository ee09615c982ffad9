"""Part of the residual that a free form predicts on motion that it was not fitted to.

What a library leaves may be noise, or structure that no entry has. Smooth functions of speed,
acceleration, position, angle, torque and time, each by direction, claim nothing but that the same
motion gives the same gap: what they predict of held-out blocks is structure, whatever its name.
"""

from collections.abc import Mapping

import numpy as np

from ..messages.samples import Floats
from .session import TORQUE_GAP, Rows, Session

FOLDS = 4
_ORDERS = {TORQUE_GAP: 24, "transmission_m": 6}
_RIDGES = (3e-4, 1e-2, 0.3)
"""Of the mean square of a column, over the number of rows."""


def foretold(session: Session, left: Mapping[str, Floats]) -> dict[str, Floats]:
    """Prediction of `left` by free forms on the blocks that they were not fitted to, by channel."""
    return {name: _foretold(session.channels[name], name, each) for name, each in left.items()}


def _foretold(rows: Rows, channel: str, left: Floats) -> Floats:
    columns = _columns(rows, channel)
    fold = rows.block % FOLDS
    grams = [columns[fold == k].T @ columns[fold == k] for k in range(FOLDS)]
    crosses = [columns[fold == k].T @ left[fold == k] for k in range(FOLDS)]
    whole, cross = sum(grams), sum(crosses)
    best: Floats = np.zeros(len(left))
    least = float(left @ left)
    for ridge in _RIDGES:
        stiff = ridge * np.diag(np.maximum(np.diag(whole), 1e-12 * np.trace(whole)))
        found = np.zeros(len(left))
        for k in range(FOLDS):
            if (fold == k).any() and (fold != k).any():
                beta = np.linalg.solve(whole - grams[k] + stiff, cross - crosses[k])
                found[fold == k] = columns[fold == k] @ beta
        square = float(np.sum((left - found) ** 2))
        if square < least:
            best, least = found, square
    return best


def _columns(rows: Rows, channel: str) -> Floats:
    """Free forms over the rows, (n, p)."""
    v = rows.variables
    way = np.where(v["direction"] < 0.0, -1.0, 1.0)
    time, place = v["time_s"], v["table_position_m"]
    speed, acceleration = v["motor_speed_rad_s"], v["motor_acceleration_rad_s2"]
    slow = np.log1p(np.abs(speed) / 0.5)
    hard = np.sign(acceleration) * np.log1p(np.abs(acceleration) / 20.0)
    smooth = [_hats(slow, 9), _hats(place, 12), _hats(hard, 9), _hats(time, 8)]
    parts = [*smooth, *(way[:, None] * each for each in smooth)]
    parts += [x[:, None] for x in (speed, acceleration, speed * place, acceleration * place)]
    parts += [x[:, None] for x in (time * speed, time * place, time * time * place)]
    angle = v["motor_angle_rad"]
    for order in range(1, _ORDERS[channel] + 1):
        turn = np.column_stack((np.sin(order * angle), np.cos(order * angle)))
        parts += [turn, way[:, None] * turn]
    columns: Floats = np.column_stack(parts)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    columns /= np.where(scale > 0.0, scale, 1.0)
    return columns


def _hats(variable: Floats, count: int) -> Floats:
    """Piecewise linear functions that add up to 1, (n, count)."""
    knots = np.linspace(float(variable.min()), float(variable.max()) + 1e-12, count)
    reach = knots[1] - knots[0]
    hats: Floats = np.maximum(1.0 - np.abs(variable[:, None] - knots) / reach, 0.0)
    return hats
