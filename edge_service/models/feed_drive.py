"""The simulated axis: plant, effects, cascade and encoders, block by block."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..messages import samples as channels
from ..messages.samples import Floats, SampleFrame
from .effects.effect import ActiveEffect
from .effects.forward import Forward, put_into
from .effects.registry import machine_effects
from .machine import Machine
from .plant.closed_loop import (
    ANGLE,
    FORCE,
    LOOP_STATE_SIZE,
    MOTOR_SPEED,
    NOISES,
    OUTPUTS,
    PAST_COLUMNS,
    PAST_SAMPLES,
    POSITION,
    SPEED,
    TEMPERATURE,
    TORQUE,
    Inputs,
    Loop,
    Sensors,
    advance_loop,
)
from .plant.controller import MAX_TORQUE_NM, Gains, gains_for
from .plant.from_machine import plant_of, screw_drag
from .plant.tables import misreading, nut_shift
from .plant.two_mass import (
    MOTOR_FRICTION,
    MOTOR_TRAVEL,
    STATE_SIZE,
    TABLE_FRICTION,
    TABLE_POSITION,
    Load,
    Loads,
    Plant,
    axial_compliance,
    resistance,
)
from .screw.friction import Number

SUBSTEP_RATE_HZ = 16_000.0
AMBIENT_C = 20.0


@dataclass(frozen=True, slots=True)
class FeedDriveSettings:
    """One simulated axis."""

    plant: Plant  # without the effects
    gains: Gains
    drag_per_percent_nm: float  # of the screw; 0 where the file knows no preload in percent
    drag_without_preload_nm: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    rate_hz: float = 1000.0  # of the cascade and of the samples
    substeps: int = 16  # steps of the plant within one period
    effects: tuple[ActiveEffect, ...] = ()  # beyond the baseline

    @classmethod
    def of_machine(
        cls, machine: Machine, rate_hz: float = 1000.0, effects: Sequence[ActiveEffect] = ()
    ) -> "FeedDriveSettings":
        """The axis of a machine file with more effects, completed by the thesis' test bench.

        Raises ValueError: the table is heavier than the whole inertia, or an effect of the machine
        file is unknown or out of its bounds.
        """
        ratio, inertia = machine.transmission_ratio_m_per_rad, machine.model.inertia_kg_m2.value
        max_torque = machine.axis.max_torque_nm or MAX_TORQUE_NM
        without_preload_nm, per_percent_nm = screw_drag(machine)
        return cls(
            plant=plant_of(machine),
            gains=gains_for(inertia, ratio, max_torque, 1.0 / rate_hz),
            drag_per_percent_nm=per_percent_nm,
            drag_without_preload_nm=without_preload_nm,
            rate_hz=rate_hz,
            substeps=math.ceil(SUBSTEP_RATE_HZ / rate_hz),
            effects=(*machine_effects(machine), *effects),
        )

    def screw_drag_nm(self, preload_percent: Number) -> Number:
        """Drag of the screw at a preload, N m, in the shape of `preload_percent`."""
        return self.drag_without_preload_nm + self.drag_per_percent_nm * preload_percent


class FeedDrive:
    """One axis under closed-loop control, from home on; any split into blocks gives equal bytes.

    Home was approached in the positive direction: the guide friction has wound up the screw, the
    forward flanks of a backlash touch, and there both encoders are set to the same position.
    """

    def __init__(
        self, settings: FeedDriveSettings, home_m: float, preload_percent: float, seed: int
    ) -> None:
        self.settings = settings
        self._home = home_m, preload_percent
        self._random = np.random.default_rng(seed)
        self._sample = 0
        screw_nm = settings.screw_drag_nm(preload_percent)
        self._forward = put_into(settings.plant, settings.effects, screw_nm)
        self._past = np.zeros((PAST_SAMPLES, PAST_COLUMNS))
        self._past[:, 0] = home_m
        self._state = np.zeros(LOOP_STATE_SIZE)
        self._state[MOTOR_TRAVEL] = self._state[TABLE_POSITION] = home_m
        wound_n = self._wind_up(screw_nm)
        self._loop = _loop_of(settings, self._forward, home_m, preload_percent, wound_n)

    def advance(
        self,
        setpoints: Floats,
        preload_percent: Floats,
        *,
        drag_nm: Floats | None = None,
        external_force_n: Floats | None = None,
        added_mass_kg: Floats | None = None,
        temperature_c: Floats | None = None,
    ) -> SampleFrame:
        """Run the next n periods and return what the drive and its encoders report.

        Args:
            setpoints: position m, speed m/s, acceleration m/s^2, shape (n, 3); the others (n,).
            preload_percent: of the dynamic load rating; it sets the nut's stiffness.
            drag_nm: drag of the screw; that of the preload unless given.
            external_force_n: on the table, positive along x; none unless given.
            added_mass_kg: on the table beside the plant's own; none unless given.
            temperature_c: of the nut's housing; unless given `AMBIENT_C`, and what effects add.

        Raises ValueError: an input has another length, or holds a value that is not finite.
        """
        count, settings = len(setpoints), self.settings
        time_s = np.arange(self._sample, self._sample + count) / settings.rate_hz
        if drag_nm is None:
            drag_nm = settings.screw_drag_nm(preload_percent)
        force_n = np.zeros(count) if external_force_n is None else external_force_n
        mass_kg = np.zeros(count) if added_mass_kg is None else added_mass_kg
        if temperature_c is None:
            temperature_c = AMBIENT_C + self._forward.temperature_rise_k(time_s)
        given = {"preload_percent": preload_percent, "drag_nm": drag_nm, "added_mass_kg": mass_kg}
        given |= {"external_force_n": force_n, "temperature_c": temperature_c}
        for name, values in given.items():
            _require_finite(name, values, (count,))
        _require_finite("setpoints", setpoints, (count, 3))
        by_time = self._forward.over_time(time_s, temperature_c)
        noise = self._random.standard_normal((count, NOISES))
        loads = by_time._replace(force_n=force_n + by_time.force_n)
        inputs = Inputs(setpoints, preload_percent, drag_nm, mass_kg, loads, noise)
        out = np.empty((count, OUTPUTS))
        advance_loop(self._loop, self._state, self._past, self._sample, inputs, out)
        self._sample += count
        sensors = settings.sensors
        reported = {
            channels.TORQUE: out[:, TORQUE].copy(),
            channels.ANGLE: out[:, ANGLE].copy(),
            channels.MOTOR_SPEED: out[:, MOTOR_SPEED].copy(),
            channels.TABLE_POSITION: out[:, POSITION].copy(),
            channels.TABLE_SPEED: out[:, SPEED].copy(),
            channels.SETPOINT: setpoints[:, 0].copy(),
            channels.TEMPERATURE: temperature_c
            + sensors.temperature_noise_c * noise[:, TEMPERATURE],
            channels.EXTERNAL_FORCE: force_n + sensors.force_noise_n * noise[:, FORCE],
        }
        return SampleFrame(time_s, reported)

    def take_on(self, effects: Sequence[ActiveEffect]) -> None:
        """Add effects from the next sample on; the encoders stay as homed.

        Raises ValueError: the effects do not go together.
        """
        before = self._loop
        self.settings = replace(self.settings, effects=(*self.settings.effects, *effects))
        home_m, preload_percent = self._home
        screw_nm = self.settings.screw_drag_nm(preload_percent)
        self._forward = put_into(self.settings.plant, self.settings.effects, screw_nm)
        loop = _loop_of(self.settings, self._forward, home_m, preload_percent, 0.0)
        homed = loop.plant._replace(stretch_zero_m=before.plant.stretch_zero_m)
        self._loop = loop._replace(plant=homed, angle_bias_rad=before.angle_bias_rad)

    def _wind_up(self, screw_nm: float) -> float:
        """Force that the spring carries at home; what holds it there is put into the state."""
        plant, start = self._forward.plant, _at_start(self._forward)
        home = self._state[:STATE_SIZE]
        dry_nm = float(start.motor_dry_nm[0]), float(start.table_dry_nm[0])
        load = Load(0.0, 0.0, screw_nm, 1.0, motor_dry_nm=dry_nm[0], table_dry_nm=dry_nm[1])
        drag, _, guide, _ = resistance(plant, load, home[MOTOR_TRAVEL], 0.0, 0.0)
        wound_n = min(guide.forward_n, drag.backward_n)
        home[MOTOR_FRICTION], home[TABLE_FRICTION] = -wound_n, wound_n
        return float(wound_n)


def _at_start(forward: Forward) -> Loads:
    """Loads at the beginning, at the temperature of the surroundings, (1,) each."""
    return forward.over_time(np.zeros(1), np.full(1, AMBIENT_C))


def _require_finite(name: str, values: Floats, shape: tuple[int, ...]) -> None:
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name}: expected finite numbers of shape {shape}")


def _loop_of(
    settings: FeedDriveSettings,
    forward: Forward,
    home_m: float,
    preload_percent: float,
    wound_n: float,
) -> Loop:
    plant = forward.plant
    shift_m, _ = nut_shift(plant.tables, home_m, plant.ratio_m_per_rad)
    shift_m += float(_at_start(forward).strain[0]) * home_m
    wound_m = wound_n * axial_compliance(plant, home_m, preload_percent)
    bias_rad, _ = misreading(plant.tables, home_m / plant.ratio_m_per_rad)
    return Loop(
        plant=plant._replace(stretch_zero_m=wound_m - shift_m),
        gains=settings.gains,
        sensors=settings.sensors,
        substeps=settings.substeps,
        angle_bias_rad=bias_rad,
        torque_per_command=1.0 / forward.command_per_torque,
        torque_limit_nm=forward.torque_limit_nm,
        position_lag_s=forward.position_lag_s,
    )
