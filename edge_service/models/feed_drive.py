"""The simulated axis: plant, cascade and encoders in one compiled loop, block by block."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..messages import channels
from ..messages.samples import Floats, SampleFrame
from .bench import plant_of
from .compiled import compiled
from .controller import MAX_TORQUE_NM, Gains, command_torque, gains_for
from .machine import Machine
from .plant import (
    FILTERED_MOTOR_SPEED,
    FILTERED_TABLE_SPEED,
    MOTOR_TRAVEL,
    STATE_SIZE,
    TABLE_POSITION,
    Load,
    Plant,
    advance_plant,
    axial_compliance,
)

SUBSTEP_RATE_HZ = 16_000.0

_INTEGRAL = STATE_SIZE  # integral part of the cascade, N m, behind the plant's state
_STATE = STATE_SIZE + 1
_TORQUE, _ANGLE, _MOTOR_SPEED, _TABLE, _TABLE_SPEED = range(5)
_OUTPUTS = 5
_FORCE, _TEMPERATURE = 5, 6
_NOISES = 7
_INPUT_NAMES = ("setpoints", "preload_percent", "drag_nm", "external_force_n", "temperature_c")


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


@dataclass(frozen=True, slots=True)
class FeedDriveSettings:
    """One simulated axis.

    Attributes:
        drag_per_percent_nm: screw drag per point of preload, N m.
        rate_hz: rate of the cascade and of the samples.
        substeps: steps of the plant within one period.
    """

    plant: Plant
    gains: Gains
    drag_per_percent_nm: float
    sensors: Sensors = field(default_factory=Sensors)
    rate_hz: float = 1000.0
    substeps: int = 16

    @classmethod
    def of_machine(cls, machine: Machine, rate_hz: float = 1000.0) -> "FeedDriveSettings":
        """The axis that a machine file describes, completed by the seed's bench.

        Raises:
            ValueError: the file lacks a number without which there is no preload in percent, or
                its table is heavier than its whole inertia.
        """
        missing = machine.missing_for_percent()
        drag_per_percent = machine.drag_per_percent_nm
        if missing is not None or drag_per_percent is None:
            raise ValueError(f"{missing}: the machine file lacks it, simulated preload needs it")
        ratio = machine.transmission_ratio_m_per_rad
        inertia = machine.model.inertia_kg_m2.value
        max_torque = machine.axis.max_torque_nm or MAX_TORQUE_NM
        return cls(
            plant=plant_of(machine),
            gains=gains_for(inertia, ratio, max_torque, 1.0 / rate_hz),
            drag_per_percent_nm=drag_per_percent,
            rate_hz=rate_hz,
            substeps=math.ceil(SUBSTEP_RATE_HZ / rate_hz),
        )


@compiled
def _quantise(value: float, step: float) -> float:
    return round(value / step) * step if step > 0.0 else value


class _Loop(NamedTuple):
    plant: Plant
    gains: Gains
    sensors: Sensors
    substeps: int
    angle_zero_m: float


class _Inputs(NamedTuple):
    """Setpoints (n, 3), unit noise (n, _NOISES), all others (n,)."""

    setpoints: Floats
    preload_percent: Floats
    drag_nm: Floats
    force_n: Floats
    noise: Floats


@compiled
def _measure(loop: _Loop, state: Floats, noise: Floats, row: Floats) -> None:
    """Write what the encoders say of `state` to `row` (_OUTPUTS,)."""
    sensors, ratio = loop.sensors, loop.plant.ratio_m_per_rad
    angle = (state[MOTOR_TRAVEL] - loop.angle_zero_m) / ratio
    angle += sensors.angle_noise_rad * noise[_ANGLE]
    row[_ANGLE] = _quantise(angle, sensors.angle_step_rad)
    row[_MOTOR_SPEED] = state[FILTERED_MOTOR_SPEED] / ratio
    row[_MOTOR_SPEED] += sensors.motor_speed_noise_rad_s * noise[_MOTOR_SPEED]
    table = state[TABLE_POSITION] + sensors.table_noise_m * noise[_TABLE]
    row[_TABLE] = _quantise(table, sensors.table_step_m)
    row[_TABLE_SPEED] = state[FILTERED_TABLE_SPEED]
    row[_TABLE_SPEED] += sensors.table_speed_noise_m_s * noise[_TABLE_SPEED]


@compiled
def _advance(loop: _Loop, state: Floats, inputs: _Inputs, out: Floats) -> None:
    """Run n periods of measuring, commanding and moving; state (_STATE,), out (n, _OUTPUTS)."""
    plant, gains = loop.plant, loop.gains
    for k in range(out.shape[0]):
        row = out[k]
        _measure(loop, state, inputs.noise[k], row)
        torque, state[_INTEGRAL] = command_torque(
            gains, inputs.setpoints[k], row[_TABLE], row[_MOTOR_SPEED], state[_INTEGRAL]
        )
        row[_TORQUE] = torque + loop.sensors.torque_noise_nm * inputs.noise[k, _TORQUE]
        compliance = axial_compliance(plant, state[TABLE_POSITION], inputs.preload_percent[k])
        load = Load(torque, inputs.force_n[k], inputs.drag_nm[k], compliance)
        advance_plant(plant, state, load, gains.period_s, loop.substeps)


class FeedDrive:
    """One axis under closed-loop control, from home on; any split into blocks gives equal bytes.

    Home was approached in the positive direction: the guide friction has wound up the screw, and
    there both encoders are set to the same position.
    """

    def __init__(
        self, settings: FeedDriveSettings, home_m: float, preload_percent: float, seed: int
    ) -> None:
        self.settings = settings
        self._random = np.random.default_rng(seed)
        self._sample = 0
        plant = settings.plant
        held_nm = settings.drag_per_percent_nm * preload_percent + plant.bearing_drag_nm
        wound_n = min(plant.guide_force_n, held_nm / plant.ratio_m_per_rad)
        wound_m = wound_n * axial_compliance(plant, home_m, preload_percent)
        self._loop = _Loop(plant, settings.gains, settings.sensors, settings.substeps, wound_m)
        self._state = np.zeros(_STATE)
        self._state[MOTOR_TRAVEL] = home_m + wound_m
        self._state[TABLE_POSITION] = home_m

    def advance(
        self,
        setpoints: Floats,
        preload_percent: Floats,
        *,
        drag_nm: Floats | None = None,
        external_force_n: Floats | None = None,
        temperature_c: Floats | None = None,
    ) -> SampleFrame:
        """Run the next n periods and return what the drive and its encoders report.

        Args:
            setpoints: position m, speed m/s, acceleration m/s^2, shape (n, 3).
            preload_percent: of the dynamic load rating, shape (n,); it sets the nut's stiffness.
            drag_nm: drag of the screw, N m, (n,); in proportion to the preload unless given.
            external_force_n: force on the table, N, positive along x, (n,); none unless given.
            temperature_c: of the nut, degC, (n,); 20 unless given.

        Raises:
            ValueError: an input has another length, or holds a value that is not finite.
        """
        settings, count = self.settings, len(setpoints)
        if drag_nm is None:
            drag_nm = settings.drag_per_percent_nm * preload_percent
        force = np.zeros(count) if external_force_n is None else external_force_n
        temperature = np.full(count, 20.0) if temperature_c is None else temperature_c
        inputs = (setpoints, preload_percent, drag_nm, force, temperature)
        shapes = ((count, 3), *[(count,)] * 4)
        for name, values, shape in zip(_INPUT_NAMES, inputs, shapes, strict=True):
            if values.shape != shape or not np.isfinite(values).all():
                raise ValueError(f"{name}: expected finite numbers of shape {shape}")
        noise = self._random.standard_normal((count, _NOISES))
        out = np.empty((count, _OUTPUTS))
        _advance(
            self._loop, self._state, _Inputs(setpoints, preload_percent, drag_nm, force, noise), out
        )
        time_s = np.arange(self._sample, self._sample + count) / settings.rate_hz
        self._sample += count
        sensors = settings.sensors
        return SampleFrame(
            time_s,
            {
                channels.TORQUE: out[:, _TORQUE].copy(),
                channels.ANGLE: out[:, _ANGLE].copy(),
                channels.MOTOR_SPEED: out[:, _MOTOR_SPEED].copy(),
                channels.TABLE_POSITION: out[:, _TABLE].copy(),
                channels.TABLE_SPEED: out[:, _TABLE_SPEED].copy(),
                channels.SETPOINT: setpoints[:, 0].copy(),
                channels.TEMPERATURE: temperature
                + sensors.temperature_noise_c * noise[:, _TEMPERATURE],
                channels.EXTERNAL_FORCE: force + sensors.force_noise_n * noise[:, _FORCE],
            },
        )
