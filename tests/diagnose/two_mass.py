"""A second axis to be diagnosed: two masses, a linear spring and bristle friction at 20 kHz.

It knows neither the library nor the other plant of these tests, and differs from both in integrator
(semi-implicit Euler), controller, friction law, noise and motion.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RATIO = 0.02 / (2.0 * np.pi)  # m/rad
STEP_S = 5e-5
ROW_STEPS = 20
LOOP_STEPS = 10
LONGEST_DELAY = 100  # loops
MACHINE_TOML = """[axis]
name = "Y"
lead_m = 0.02
stroke_m = 0.8
screw_diameter_m = 0.02
screw_length_m = 0.998
dynamic_load_rating_n = 7450.0
bearing_arrangement = "fixed-free"

[model]
inertia_kg_m2 = 1.5e-3
viscous_nm_s_per_rad = 5.0e-3
preload_drag_nm = 0.146
table_mass_kg = 30.0
"""


class Axis(NamedTuple):
    """Truth about the axis; a fault is another value. SI units."""

    motor_kg_m2: float = 1.196e-3
    table_kg: float = 30.0
    stiffness_n_per_m: float = 2e9
    damping_ratio: float = 0.15
    play_m: float = 0.0
    motor_coulomb_nm: float = 0.0664
    table_coulomb_n: float = 25.0
    viscous_nm_s: float = 5e-3
    bristle_nm_per_rad: float = 300.0
    rough_nm: float = 0.0
    rough_at_m: float = 0.4
    rough_width_m: float = 0.05
    cogging_nm: float = 0.002
    delay_loops: int = 0
    hum_n: float = 0.0
    hum_rad_s: float = 26.0


@njit
def _bristle(bend, speed, stiffness, level, dt):  # type: ignore[no-untyped-def]
    """Implicit step of Dahl's model."""
    return (bend + dt * speed) / (1.0 + dt * abs(speed) * stiffness / level)


@njit
def _spring(axis, stretch, rate):  # type: ignore[no-untyped-def]
    """Force on the table; home is at the positive flank of the play."""
    damping = 2.0 * axis.damping_ratio * np.sqrt(axis.stiffness_n_per_m * axis.table_kg)
    if axis.play_m > 0.0 and -axis.play_m <= stretch <= 0.0:
        return 0.02 * damping * rate
    contact = stretch + axis.play_m if stretch < 0.0 else stretch
    return axis.stiffness_n_per_m * contact + damping * rate


@njit
def _moved(axis, setpoints_m):  # type: ignore[no-untyped-def]
    """Rows of torque command, motor angle and table position, (n, 3)."""
    rows = np.zeros((len(setpoints_m), 3))
    late = np.zeros(LONGEST_DELAY)
    angle, speed, bend = setpoints_m[0] / RATIO, 0.0, 0.0
    table, pace, rub = setpoints_m[0], 0.0, 0.0
    integral, loop = 0.0, 0
    inertia = 0.8 * (axis.motor_kg_m2 + axis.table_kg * RATIO * RATIO)
    for row in range(1, len(setpoints_m) - 1):
        wanted = (setpoints_m[row + 1] - setpoints_m[row]) / 1e-3
        jump = (setpoints_m[row + 1] - 2.0 * setpoints_m[row] + setpoints_m[row - 1]) / 1e-6
        for step in range(ROW_STEPS):
            if step % LOOP_STEPS == 0:
                lag = setpoints_m[row] + wanted * step * STEP_S - RATIO * angle
                miss = (wanted + 35.0 * lag) / RATIO - speed
                integral += 0.25 / 0.02 * miss * LOOP_STEPS * STEP_S
                torque = 0.25 * miss + integral + inertia * jump / RATIO
                late[loop % LONGEST_DELAY] = torque
                if step == 0:
                    rows[row] = torque, angle, table
                loop += 1
            acting = late[(loop - 1 - axis.delay_loops) % LONGEST_DELAY]
            there = (table - axis.rough_at_m) / axis.rough_width_m
            level = axis.motor_coulomb_nm + axis.rough_nm * np.exp(-0.5 * there * there)
            bend = _bristle(bend, speed, axis.bristle_nm_per_rad, level, STEP_S)
            rub = _bristle(rub, pace, 5e7, axis.table_coulomb_n, STEP_S)
            friction = axis.bristle_nm_per_rad * bend + axis.viscous_nm_s * speed
            friction += axis.cogging_nm * np.sin(4.0 * angle)
            force = _spring(axis, RATIO * angle - table, RATIO * speed - pace)
            hum = axis.hum_n * np.sin(axis.hum_rad_s * 1e-3 * (row + step / ROW_STEPS))
            speed += STEP_S * (acting - friction - RATIO * force) / axis.motor_kg_m2
            pace += STEP_S * (force + hum - 5e7 * rub) / axis.table_kg
            angle += STEP_S * speed
            table += STEP_S * pace
    return rows


def setpoints() -> Floats:
    """Creeps, short reversals and rests at three places, and passes at three speeds, in m."""
    plan: list[tuple[float, float, float]] = []
    for place in (0.15, 0.4, 0.65):
        plan += [(place, 0.2, 2.0)]
        plan += [(place + reach, 0.02, 0.5) for reach in (2e-4, 0.0, 2e-3, 0.0)]
        plan += [(place + 0.02, 0.02, 1.0), (place, 0.02, 1.0)]
        plan += [(place + 0.004, 0.004, 1.0), (place, 0.004, 1.0)]
    for speed, acceleration in ((0.1, 2.0), (0.25, 3.0), (0.4, 4.0), (0.4, 2.0)):
        plan += [(0.1, speed, acceleration), (0.7, speed, acceleration)]
    parts, at = [np.full(500, 0.1)], 0.1
    for end, speed, acceleration in plan:
        parts += [_way(at, end, speed, acceleration), np.full(250, end)]
        at = end
    return np.concatenate(parts)


def _way(start_m: float, end_m: float, speed_m_s: float, acceleration_m_s2: float) -> Floats:
    """A trapezoid of speed, its corners rounded over 30 ms."""
    way = abs(end_m - start_m)
    top = min(speed_m_s, np.sqrt(way * acceleration_m_s2))
    time_s = np.arange(0.0, way / top + top / acceleration_m_s2, 1e-3)
    ramp = acceleration_m_s2 * np.minimum(time_s, time_s[-1] - time_s)
    covered = np.cumsum(np.convolve(np.minimum(ramp, top), np.ones(30) / 30.0))
    return start_m + (end_m - start_m) * covered / covered[-1]


def recording(axis: Axis, seed: int) -> dict[str, Floats]:
    """Columns at 1 kHz, with noise and quanta; the parameters are off by some 0.4 %."""
    random = np.random.default_rng(seed)
    off = 1.0 + 0.004 * random.standard_normal(3)
    axis = axis._replace(
        motor_kg_m2=axis.motor_kg_m2 * off[0],
        viscous_nm_s=axis.viscous_nm_s * off[1],
        motor_coulomb_nm=axis.motor_coulomb_nm * off[2],
    )
    wanted = setpoints()
    rows = _moved(axis, wanted)[1:-1]
    columns = {"time_s": 1e-3 * np.arange(len(rows)), "position_setpoint_m": wanted[1:-1]}
    for values, (name, (noise, quantum)) in zip(rows.T, SENSORS.items(), strict=True):
        noisy = values + noise * random.standard_normal(len(values))
        columns[name] = quantum * np.round(noisy / quantum)
    return columns


SENSORS = {
    "torque_command_nm": (0.012, 1e-3),
    "motor_angle_rad": (2e-6, 3e-6),
    "table_position_m": (5e-8, 5e-8),
}
"""Noise and quantum."""
