"""Inverse simulation: an axis with the measured motion of a run prescribed, for its torque.

Its motor makes the measured motion, so controllers have no part in what is compared. What lies
outside the plant, the torque's path and the encoders' errors, is put on afterwards.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy import interpolate

from ...messages.samples import Floats, Integers
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.effect import ActiveEffect
from ...models.effects.forward import Forward, put_into
from ...models.effects.learned import model_effects
from ...models.feed_drive import SUBSTEP_RATE_HZ
from ...models.machine import Machine
from ...models.plant.from_machine import plant_of
from ...models.plant.prescribed_motion import (
    STRETCH,
    TORQUE,
    Way,
    following_state,
    simulate_inverse,
)
from ...models.plant.tables import misreading
from ...models.plant.two_mass import Loads, Plant, axial_compliance
from ...recordings.conditioning import central_difference
from ...regression.run import Run
from .session import rigid_plant

_DAMPING_RATIO = 0.3
"""Of the table on its spring: what is compared ends below that resonance."""
_PRELOAD_PERCENT = 7.0
"""The nut of a plant whose springs are too stiff to show."""


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedMotionAxis:
    """Axis of a machine file, as stiff as its model takes it for."""

    plant: Plant
    baseline: Baseline
    screw_nm: float  # drag of the screw
    known: tuple[ActiveEffect, ...]  # effects of the machine file

    @classmethod
    def of_machine(cls, machine: Machine, baseline: Baseline) -> "PrescribedMotionAxis":
        """Axis behind a baseline."""
        plant = rigid_plant(plant_of(machine))
        others_nm = plant.bearing_drag_nm + plant.guide_force_n * plant.ratio_m_per_rad
        known = tuple(model_effects(machine))
        return cls(plant, baseline, baseline.coulomb_nm - others_nm, known)

    def with_effects(self, effects: Sequence[ActiveEffect]) -> Forward:
        """Plant with further effects, damped.

        Raises ValueError: they leave no mass on the table.
        """
        forward = put_into(self.plant, (*self.known, *effects), self.screw_nm)
        plant = forward.plant
        compliance = axial_compliance(plant, 0.5 * plant.screw_length_m, _PRELOAD_PERCENT)
        damping = 2.0 * _DAMPING_RATIO * math.sqrt(plant.table_mass_kg / compliance)
        return replace(forward, plant=plant._replace(damping_n_s_per_m=damping))

    def simulated(self, run: Run, variants: Sequence[Forward], number: Integers) -> Run:
        """Simulate the torque and transmission of a run whose motion is prescribed.

        Args:
            variants: plants with effects.
            number: which of them holds at each sample, (n,).

        Raises ValueError: a plant leaves the finite numbers.
        """
        motion, ratio = run.motion, self.plant.ratio_m_per_rad
        misread = np.choose(number, [_misread_rad(each, motion.angle_rad) for each in variants])
        travel = ratio * (motion.angle_rad - misread)
        speed = motion.speed_rad_s - central_difference(misread, run.period_s)
        shaft_nm, ahead_m = self._moved(motion, travel, ratio * speed, variants, number)
        command_nm = _command(motion, shaft_nm, variants, number)
        lag_s = _of(number, variants, "position_lag_s")
        if np.any(lag_s):
            table_m = interpolate.CubicSpline(motion.time_s, travel + ahead_m)
            ahead_m = table_m(motion.time_s - lag_s) - travel
        stretch_m = ahead_m - ratio * misread
        if not (np.isfinite(command_nm).all() and np.isfinite(stretch_m).all()):
            raise ValueError("the simulation with these effects diverges")
        return replace(
            run,
            motion=replace(motion, torque_nm=command_nm) if run.has_torque else motion,
            transmission_m=None if run.transmission_m is None else stretch_m,
        )

    def _moved(
        self,
        motion: Motion,
        travel: Floats,
        speed: Floats,
        variants: Sequence[Forward],
        number: Integers,
    ) -> tuple[Floats, Floats]:
        """Torque at the shaft, and how far the table is ahead of the motor, (n,) each."""
        period_s = float(motion.time_s[1] - motion.time_s[0])
        loads = [each.over_time(motion.time_s, motion.temperature_c) for each in variants]
        way = self._way(motion, speed, loads, number)
        offset_m = float(np.median(motion.position_m - travel))
        plants = []  # whose positions count as the table's, ahead of the travel
        for plant in (each.plant for each in variants):
            low_m = plant.tables.position_low_m - offset_m
            tables = plant.tables._replace(position_low_m=low_m)
            plants.append(plant._replace(torque_lag_s=0.0, tables=tables))
        first = float(travel[0]), float(way.speed_m_s[0]), float(way.loads.strain[0])
        state = following_state(plants[number[0]], *first, float(motion.approach[0]))
        out = np.empty((len(motion), 2))
        substeps = math.ceil(SUBSTEP_RATE_HZ * period_s)
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(motion)]
        for start, end in itertools.pairwise(edges):
            rows = slice(start, end + 1)
            loads_now = Loads(*(each[rows] for each in way.loads))
            part = Way(way.speed_m_s[rows], way.place_m[rows], loads_now)
            screw = self.screw_nm, _PRELOAD_PERCENT
            plant = plants[number[start]]
            out[start:end] = simulate_inverse(plant, *screw, period_s, substeps, state, part)
        # means over the periods that begin at the samples, as values there: the mean of two periods
        # is low by (w T)^2 / 6, which is put back
        mean = out[:, TORQUE]
        values = 0.5 * (mean + np.concatenate((mean[:1], mean[:-1])))
        return values - np.pad(np.diff(values, 2), 1) / 6.0, out[:, STRETCH]

    def _way(self, motion: Motion, speed: Floats, loads: Sequence[Loads], number: Integers) -> Way:
        """Prescribed motion and loads, one sample longer than the motion, which it extrapolates."""
        # the recorded external force on the table is part of the model's load torque
        base = self.baseline
        inertia_nm = base.table_inertia_kg_m2 * motion.table_rad_s2
        known_n = -(motion.load_torque_nm - inertia_nm) / base.ratio_m_per_rad
        by_time = Loads(*(np.choose(number, each) for each in zip(*loads, strict=True)))
        by_time = by_time._replace(force_n=by_time.force_n + known_n)
        return Way(_extended(speed), _extended(motion.position_m), Loads(*map(_extended, by_time)))


def _command(
    motion: Motion, shaft_nm: Floats, variants: Sequence[Forward], number: Integers
) -> Floats:
    lag_s = _of(number, variants, "plant.torque_lag_s")
    command = shaft_nm + lag_s * np.gradient(shaft_nm, motion.time_s)
    command = command * _of(number, variants, "command_per_torque")
    beyond = np.abs(motion.torque_nm) - _of(number, variants, "torque_limit_nm")
    cut_off = np.sign(motion.torque_nm) * np.maximum(beyond, 0.0)
    return np.asarray(command + np.nan_to_num(cut_off))


def _misread_rad(forward: Forward, reading_rad: Floats) -> Floats:
    """Error of the rotary encoder where it reads these angles, to first order."""
    tables = forward.plant.tables
    if tables.angle_points == 0:
        return np.zeros_like(reading_rad)
    errors = [misreading(tables, angle)[0] for angle in _TURN]
    return np.asarray(np.interp(np.mod(reading_rad, _TURN[-1]), _TURN, errors))


_TURN = np.linspace(0.0, 2.0 * math.pi, 4097)


def _extended(series: Floats) -> Floats:
    return np.append(series, 2.0 * series[-1] - series[-2])


def _of(number: Integers, variants: Sequence[Forward], name: str) -> Floats:
    """Constant of the variant that holds at each sample, (n,)."""
    return np.asarray(np.array([attrgetter(name)(each) for each in variants])[number])
