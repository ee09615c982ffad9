"""Functions of one variable as tables, for the compiled plant: linear between grid points.

Columns: dry friction of the motor side and of the table side, smooth torque of the motor side and
of the table side (all N m at the motor; smooth torque acts against positive motion); over position
and angle the shift of the nut along the screw, m; over angle the encoder's misreading, rad.
"""

import math
from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ..compiled import compiled

DRY_MOTOR, DRY_TABLE, SMOOTH_MOTOR, SMOOTH_TABLE, NUT_SHIFT, MISREADING = range(6)
COLUMNS = 6

_SPEED_POINTS = 2048
_SLOWEST_RAD_S = 0.02
_FASTEST_RAD_S = 3000.0
_SPEED_STEP = math.asinh(_FASTEST_RAD_S / _SLOWEST_RAD_S) / (_SPEED_POINTS - 1)
_TURN_POINTS = 4096
_TURN_RAD = 2.0 * math.pi
_POSITION_POINTS = 4096
_OVERHANG = 0.1
"""Share of the screw's length that a table over position reaches beyond either end."""


class Tables(NamedTuple):
    """Tables of one plant, one below the other; each may be missing.

    One array and not five: the compiled plant counts references to each array in every call. The
    grid over speed is even in asinh(speed): it resolves creep and rapids.
    """

    rows: Floats  # (n, COLUMNS); over position, a turn, the size of the speed forwards, backwards
    position_points: int  # rows of each; 0 is a missing table
    angle_points: int
    speed_points: int
    position_low_m: float
    position_step_m: float


NO_TABLES = Tables(np.zeros((1, COLUMNS)), 0, 0, 0, 0.0, 1.0)


class Found(NamedTuple):
    """Values of the tables at one moment, N m at the motor; the columns above by their names."""

    motor_forward_nm: float
    motor_backward_nm: float
    motor_smooth_nm: float
    table_forward_nm: float
    table_backward_nm: float
    table_smooth_nm: float


def speed_grid() -> Floats:
    """Sizes of the motor speed in a table, rad/s, (n,); the first is next to nothing, not 0."""
    grid: Floats = _SLOWEST_RAD_S * np.sinh(_SPEED_STEP * np.arange(_SPEED_POINTS))
    grid[0] = 1e-9
    return grid


def angle_grid() -> Floats:
    """Angles in a table, rad, (n,): one turn with both its ends."""
    return np.linspace(0.0, _TURN_RAD, _TURN_POINTS + 1)


def position_grid(length_m: float) -> Floats:
    """Positions in a table for a screw of `length_m`, m, (n,); the ends stand for all beyond."""
    return np.linspace(-_OVERHANG * length_m, (1.0 + _OVERHANG) * length_m, _POSITION_POINTS)


def stack(
    position: Floats, angle: Floats, forward: Floats, backward: Floats, length_m: float
) -> Tables:
    """Tables from their parts, (n, COLUMNS) each over its grid; (0, COLUMNS) is a missing one."""
    rows = np.concatenate((position, angle, forward, backward))
    grid = position_grid(length_m)
    return Tables(
        rows=rows if len(rows) else NO_TABLES.rows,
        position_points=len(position),
        angle_points=len(angle),
        speed_points=len(forward),
        position_low_m=float(grid[0]),
        position_step_m=float(grid[1] - grid[0]),
    )


@compiled
def _split(place: float, first: int, points: int) -> tuple[int, float]:
    """Row before a place in a table that begins at row `first`, and the share of the next row."""
    inside = min(max(place, 0.0), points - 1.0)
    before = min(int(inside), points - 2)
    return first + before, inside - before


@compiled
def _at_position(tables: Tables, position_m: float) -> tuple[int, float]:
    place = (position_m - tables.position_low_m) / tables.position_step_m
    return _split(place, 0, tables.position_points)


@compiled
def _at_angle(tables: Tables, angle_rad: float) -> tuple[int, float]:
    turns = angle_rad / _TURN_RAD
    place = (turns - math.floor(turns)) * (tables.angle_points - 1)
    return _split(place, tables.position_points, tables.angle_points)


@compiled
def _between(rows: Floats, at: tuple[int, float], column: int) -> float:
    before, share = at
    low = float(rows[before, column])
    return low + share * (float(rows[before + 1, column]) - low)


@compiled
def _rise(rows: Floats, at: tuple[int, float], column: int) -> float:
    return float(rows[at[0] + 1, column]) - float(rows[at[0], column])


@compiled
def find_friction(tables: Tables, position_m: float, angle_rad: float, speed_rad_s: float) -> Found:
    """Sums of all tables of friction and torque at a position, an angle and a speed."""
    rows = tables.rows
    dry1, dry2, smooth1, smooth2 = 0.0, 0.0, 0.0, 0.0
    if tables.position_points > 0:
        at = _at_position(tables, position_m)
        dry1 += _between(rows, at, DRY_MOTOR)
        dry2 += _between(rows, at, DRY_TABLE)
        smooth1 += _between(rows, at, SMOOTH_MOTOR)
        smooth2 += _between(rows, at, SMOOTH_TABLE)
    if tables.angle_points > 0:
        at = _at_angle(tables, angle_rad)
        dry1 += _between(rows, at, DRY_MOTOR)
        dry2 += _between(rows, at, DRY_TABLE)
        smooth1 += _between(rows, at, SMOOTH_MOTOR)
        smooth2 += _between(rows, at, SMOOTH_TABLE)
    if tables.speed_points == 0:
        return Found(dry1, dry1, smooth1, dry2, dry2, smooth2)
    place = math.asinh(abs(speed_rad_s) / _SLOWEST_RAD_S) / _SPEED_STEP
    first = tables.position_points + tables.angle_points
    ahead = _split(place, first, tables.speed_points)
    back = (ahead[0] + tables.speed_points, ahead[1])
    way = ahead if speed_rad_s >= 0.0 else back
    return Found(
        dry1 + _between(rows, ahead, DRY_MOTOR),
        dry1 + _between(rows, back, DRY_MOTOR),
        smooth1 + _between(rows, way, SMOOTH_MOTOR),
        dry2 + _between(rows, ahead, DRY_TABLE),
        dry2 + _between(rows, back, DRY_TABLE),
        smooth2 + _between(rows, way, SMOOTH_TABLE),
    )


@compiled
def nut_shift(tables: Tables, travel_m: float, ratio_m_per_rad: float) -> tuple[float, float]:
    """Shift of the nut along the screw where it would stand at `travel_m`, m, and its slope."""
    shift, slope = 0.0, 0.0
    if tables.position_points > 0:
        at = _at_position(tables, travel_m)
        shift += _between(tables.rows, at, NUT_SHIFT)
        slope += _rise(tables.rows, at, NUT_SHIFT) / tables.position_step_m
    if tables.angle_points > 0:
        at = _at_angle(tables, travel_m / ratio_m_per_rad)
        shift += _between(tables.rows, at, NUT_SHIFT)
        per_rad = (tables.angle_points - 1) / _TURN_RAD
        slope += _rise(tables.rows, at, NUT_SHIFT) * per_rad / ratio_m_per_rad
    return shift, slope


@compiled
def misreading(tables: Tables, angle_rad: float) -> tuple[float, float]:
    """Error of the rotary encoder, rad, and its slope over the angle, rad/rad."""
    if tables.angle_points == 0:
        return 0.0, 0.0
    at = _at_angle(tables, angle_rad)
    per_rad = (tables.angle_points - 1) / _TURN_RAD
    return _between(tables.rows, at, MISREADING), _rise(tables.rows, at, MISREADING) * per_rad
