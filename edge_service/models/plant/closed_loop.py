"""The compiled loop of a simulated axis: measure, command, move; readings with noise and skew."""

import math
from typing import NamedTuple

from ...messages.samples import Floats
from ..compiled import compiled
from .controller import Gains, command_torque
from .tables import misreading
from .two_mass import (
    FILTERED_MOTOR_SPEED,
    FILTERED_TABLE_SPEED,
    MOTOR_TRAVEL,
    STATE_SIZE,
    TABLE_POSITION,
    TABLE_SPEED,
    Loads,
    Plant,
    advance_plant,
    axial_compliance,
    load_at,
)

TORQUE, ANGLE, MOTOR_SPEED, POSITION, SPEED = range(5)
OUTPUTS = 5
FORCE, TEMPERATURE = 5, 6
NOISES = 7
"""Unit noise per sample: one for each output, then of force and of temperature."""

_PAST_POSITION, _PAST_SPEED, _PAST_FILTERED = range(3)
PAST_COLUMNS = 3
PAST_SAMPLES = 48
"""Enough for 5 ms of skew at 8 kHz, with a sample on either side."""


class Sensors(NamedTuple):
    """Standard deviations of the noise per sample and steps of the encoders; 0.0 is ideal.

    The torque noise is that of the record: the shaft gets the torque without it.
    """

    torque_noise_nm: float = 0.02
    angle_noise_rad: float = 5e-6
    motor_speed_noise_rad_s: float = 0.01
    table_noise_m: float = 5e-8
    table_speed_noise_m_s: float = 5e-5
    force_noise_n: float = 1.0
    temperature_noise_c: float = 0.02
    angle_step_rad: float = 2.0 * math.pi / 2**22
    table_step_m: float = 1e-8

    def noisier(self, times: float) -> "Sensors":
        """The same with `times` the noise of torque and encoders."""
        torque, angle = times * self.torque_noise_nm, times * self.angle_noise_rad
        table = times * self.table_noise_m
        return self._replace(torque_noise_nm=torque, angle_noise_rad=angle, table_noise_m=table)


@compiled
def _quantise(value: float, step: float) -> float:
    return round(value / step) * step if step > 0.0 else value


@compiled
def _write_linear(
    sensors: Sensors, position_m: float, speed_m_s: float, noise: Floats, row: Floats
) -> None:
    position = position_m + sensors.table_noise_m * noise[POSITION]
    row[POSITION] = _quantise(position, sensors.table_step_m)
    row[SPEED] = speed_m_s + sensors.table_speed_noise_m_s * noise[SPEED]


@compiled
def measure(
    sensors: Sensors, plant: Plant, state: Floats, angle_bias_rad: float, noise: Floats, row: Floats
) -> None:
    """Write what all but the torque sensor say of `state` to `row` (OUTPUTS,).

    `angle_bias_rad` is the encoder's misreading at home, where it was set right.
    """
    true_rad = state[MOTOR_TRAVEL] / plant.ratio_m_per_rad
    error_rad, slope = misreading(plant.tables, true_rad)
    angle = true_rad + error_rad - angle_bias_rad
    row[ANGLE] = _quantise(angle + sensors.angle_noise_rad * noise[ANGLE], sensors.angle_step_rad)
    row[MOTOR_SPEED] = (1.0 + slope) * state[FILTERED_MOTOR_SPEED] / plant.ratio_m_per_rad
    row[MOTOR_SPEED] += sensors.motor_speed_noise_rad_s * noise[MOTOR_SPEED]
    _write_linear(sensors, state[TABLE_POSITION], state[FILTERED_TABLE_SPEED], noise, row)


@compiled
def remember(state: Floats, past: Floats, sample: int) -> None:
    """Keep the table's motion at a sample in the ring `past` (PAST_SAMPLES, PAST_COLUMNS)."""
    kept = past[sample % PAST_SAMPLES]
    kept[_PAST_POSITION] = state[TABLE_POSITION]
    kept[_PAST_SPEED] = state[TABLE_SPEED]
    kept[_PAST_FILTERED] = state[FILTERED_TABLE_SPEED]


@compiled
def measure_late(
    sensors: Sensors,
    past: Floats,
    sample: int,
    period_s: float,
    lag_s: float,
    noise: Floats,
    row: Floats,
) -> None:
    """Overwrite the linear channels of `row` with those of `lag_s` ago.

    The past is interpolated by cubic Hermite polynomials. A negative lag is a look ahead, at the
    acceleration of the latest period: at 200 m/s^3 of jerk 2 ms ahead are off by 0.3 um at most.
    """
    now = past[sample % PAST_SAMPLES]
    if lag_s < 0.0:
        before = past[(sample - 1) % PAST_SAMPLES]
        acceleration = (now[_PAST_SPEED] - before[_PAST_SPEED]) / period_s
        position = now[_PAST_POSITION] - lag_s * (now[_PAST_SPEED] - 0.5 * lag_s * acceleration)
        _write_linear(sensors, position, now[_PAST_FILTERED] - lag_s * acceleration, noise, row)
        return
    periods = lag_s / period_s
    whole = min(int(periods), PAST_SAMPLES - 2)
    late, early = past[(sample - whole) % PAST_SAMPLES], past[(sample - whole - 1) % PAST_SAMPLES]
    t = 1.0 - (periods - whole)
    rise = late[_PAST_POSITION] - early[_PAST_POSITION]
    bend0 = period_s * early[_PAST_SPEED] - rise
    bend1 = rise - period_s * late[_PAST_SPEED]
    position = early[_PAST_POSITION] + t * rise
    position += t * (1.0 - t) * (bend0 * (1.0 - t) + bend1 * t)
    filtered = early[_PAST_FILTERED] + t * (late[_PAST_FILTERED] - early[_PAST_FILTERED])
    _write_linear(sensors, position, filtered, noise, row)


INTEGRAL = STATE_SIZE  # integral part of the cascade, N m, behind the plant's state
LOOP_STATE_SIZE = STATE_SIZE + 1


class Loop(NamedTuple):
    """Constants of the loop; `torque_per_command` is below 1 where the motor is too weak."""

    plant: Plant
    gains: Gains
    sensors: Sensors
    substeps: int
    angle_bias_rad: float
    torque_per_command: float
    torque_limit_nm: float
    position_lag_s: float


class Inputs(NamedTuple):
    """Setpoints (n, 3), unit noise (n, NOISES), the others (n,)."""

    setpoints: Floats
    preload_percent: Floats
    screw_drag_nm: Floats
    added_mass_kg: Floats
    loads: Loads
    noise: Floats


@compiled
def advance_loop(
    loop: Loop, state: Floats, past: Floats, first: int, inputs: Inputs, out: Floats
) -> None:
    """Run n periods of measuring, commanding and moving.

    Args:
        state: of plant and cascade, (LOOP_STATE_SIZE,), advanced in place.
        past: ring of the table's motion, (PAST_SAMPLES, PAST_COLUMNS).
        first: number of the first sample.
        out: what is reported, (n, OUTPUTS).
    """
    plant, gains, sensors = loop.plant, loop.gains, loop.sensors
    for k in range(out.shape[0]):
        row, noise = out[k], inputs.noise[k]
        measure(sensors, plant, state, loop.angle_bias_rad, noise, row)
        command_nm, state[INTEGRAL] = command_torque(
            gains, inputs.setpoints[k], row[POSITION], row[MOTOR_SPEED], state[INTEGRAL]
        )
        row[TORQUE] = command_nm + sensors.torque_noise_nm * noise[TORQUE]
        if loop.position_lag_s != 0.0:
            remember(state, past, first + k)
            lag_s = loop.position_lag_s
            measure_late(sensors, past, first + k, gains.period_s, lag_s, noise, row)
        given_nm = command_nm * loop.torque_per_command
        given_nm = min(max(given_nm, -loop.torque_limit_nm), loop.torque_limit_nm)
        compliance = axial_compliance(plant, state[TABLE_POSITION], inputs.preload_percent[k])
        drag_nm, mass_kg = inputs.screw_drag_nm[k], inputs.added_mass_kg[k]
        load = load_at(inputs.loads, k, given_nm, drag_nm, compliance, mass_kg)
        advance_plant(plant, state, load, gains.period_s, loop.substeps)
