"""The compiled loop of a simulated axis: measure, command, move."""

from typing import NamedTuple

from ...messages.samples import Floats
from ..compiled import compiled
from .controller import Gains, command_torque
from .encoders import (
    MOTOR_SPEED,
    POSITION,
    TORQUE,
    Sensors,
    measure,
    measure_late,
    remember,
)
from .two_mass import (
    STATE_SIZE,
    TABLE_POSITION,
    Loads,
    Plant,
    advance_plant,
    axial_compliance,
    load_at,
)

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
