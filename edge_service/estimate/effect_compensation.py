"""Compensation of a machine file's `[[effects]]` in the phases of a motion.

A known effect is no change of the axis: commissioning and estimate see the axis without it. Effects
that change in time (warmth, growth, process forces) stay in, for the estimate follows them by
itself, and so does the level of the drag, for preload is estimated from it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..messages.features import Phase
from ..models.effects import contribution as of
from ..models.effects.baseline import Baseline, Motion
from ..models.effects.contribution import Change, Constant, Contribution, Over, Play
from ..models.effects.effect import ActiveEffect, Term
from ..models.effects.registry import machine_effects
from ..models.effects.signature import torque_signature, transmission_signature
from ..models.machine import Machine

_POINTS = 17
_APPROACH_M = 5e-3
"""Way of unbroken motion before a phase: longer than any play, and less than a gate lets pass."""
_MOMENTS_S = np.array([0.0, 1.0, 1e2, 1e4])
_FLOATING_N = 15.0
"""With a smaller force through the nut the table may lie anywhere within its play."""
_DYNAMIC = frozenset({Constant.TORQUE_LAG, Constant.TORQUE_LIMIT})


@dataclass(frozen=True, slots=True, eq=False)
class EffectCompensation:
    """Effects of one machine file, by their compensation in a phase."""

    used: tuple[ActiveEffect, ...]  # compensated
    left: tuple[str, ...]  # names of the others, which stay in
    command_share: float  # of the torque command above the torque that arrives
    baseline: Baseline

    @classmethod
    def of_machine(cls, machine: Machine) -> "EffectCompensation":
        """Effects of a machine file. Raises ValueError: one or its parameter does not exist."""
        every = machine_effects(machine)
        used = tuple(one for one in every if _steady(one))
        share = math.prod(1.0 + each.value for one in used for each in _command_shares(one))
        left = tuple(one.effect.name for one in every if not _steady(one))
        return cls(used, left, share - 1.0, _baseline(machine))

    def compensated(self, phase: Phase, direction: float, time_s: float) -> Phase:
        """Phase of the axis without these effects; `direction` is -1 or 1.

        Its angle is NaN where they leave the stretch unknown.
        """
        if not (phase.steady_s > 0.0 and np.isfinite(phase.angle_rad)):
            return phase
        motion = _motion(self.baseline, phase, direction, time_s)
        torque_nm, shift_m = 0.0, 0.0
        for one in self.used:
            torque = torque_signature(one.effect, one.values, motion, self.baseline)
            shift = transmission_signature(one.effect, one.values, motion, self.baseline)
            if not _command_shares(one):
                torque_nm += float(np.mean(torque[1:]))
            if any(isinstance(each, Play) for each in one.contributions):
                shift_m += _flank(one, motion, self.baseline)
            else:
                shift_m += float(np.mean(shift[1:]))
        return replace(
            phase,
            torque_nm=phase.torque_nm / (1.0 + self.command_share) - torque_nm,
            angle_rad=phase.angle_rad + shift_m / self.baseline.ratio_m_per_rad,
        )


def _command_shares(one: ActiveEffect) -> list[Change]:
    changes = [each for each in one.contributions if isinstance(each, Change)]
    return [each for each in changes if each.quantity is Constant.COMMAND_SHARE]


def _flank(one: ActiveEffect, motion: Motion, baseline: Baseline) -> float:
    """x - R theta by the flank that carries, m: the width where the force is negative.

    An axis that brakes hard is pushed by its table, which lies on the other flank then. NaN where
    hardly any force is carried.
    """
    carried_nm = motion.load_torque_nm + baseline.table_coulomb_nm * motion.direction
    force_n = float(np.mean(carried_nm[1:])) / baseline.ratio_m_per_rad
    width_m = sum(each.width_m for each in one.contributions if isinstance(each, Play))
    if abs(force_n) < _FLOATING_N:
        return math.nan
    return width_m if force_n < 0.0 else 0.0


def _steady(one: ActiveEffect) -> bool:
    """Return whether means over a phase determine the effect's influence on them."""
    return one.effect.term is not Term.COULOMB and not any(map(_fleeting, one.contributions))


def _fleeting(contribution: Contribution) -> bool:
    match contribution:
        case of.DryFriction(over, curve) | of.SmoothTorque(over, curve) | of.Shift(_, over, curve):
            is_fading = over is Over.TIME and bool(np.ptp(curve(_MOMENTS_S)) > 0.0)
            return is_fading or over is Over.TEMPERATURE
        case of.TableForce() | of.Strain() | of.ViscousFriction() | of.Warming():
            return True
        case of.PreslidingWindUp() | of.LoadFriction() | Play():
            return False
        case Change(quantity, _):
            return quantity in _DYNAMIC


def _baseline(machine: Machine) -> Baseline:
    """Baseline with the commissioned compliance where there is one."""
    baseline, mass = Baseline.of_machine(machine), machine.model.table_mass_kg
    commissioned = machine.commissioned
    if commissioned is None or commissioned.transmission is None or mass is None:
        return baseline
    t = commissioned.transmission
    away_m = baseline.position_m - t.reference_m
    stretch_s2 = t.stretch_per_acceleration_s2 + t.stretch_slope_s2_per_m * away_m
    stretch_s2 += t.stretch_bow_s2_per_m2 * away_m**2
    return replace(baseline, compliance_m_per_n=np.maximum(stretch_s2 / mass.value, 0.0))


def _motion(baseline: Baseline, phase: Phase, direction: float, time_s: float) -> Motion:
    """One phase as motion at a constant acceleration, and before it one point of its approach."""
    half_s = 0.5 * phase.steady_s
    t = np.linspace(-half_s, half_s, _POINTS)
    mean_square = half_s**2 * (_POINTS + 1) / (3.0 * (_POINTS - 1))
    turned = phase.speed_rad_s * t + 0.5 * phase.acceleration_rad_s2 * (t**2 - mean_square)
    approach_rad = direction * _APPROACH_M / baseline.ratio_m_per_rad
    turned = np.concatenate([turned[:1] - approach_rad, turned])
    speed = phase.speed_rad_s + phase.acceleration_rad_s2 * np.concatenate([t[:1], t])
    speed = direction * np.maximum(direction * speed, 1e-9)
    known = np.isfinite(phase.table_m)
    place_m = phase.table_m if known else baseline.ratio_m_per_rad * phase.angle_rad
    return Motion.of_samples(
        baseline,
        np.concatenate([[time_s - half_s - 1.0], time_s + t]),
        phase.angle_rad + turned,
        speed,
        np.full(_POINTS + 1, phase.acceleration_rad_s2),
        position_m=place_m + baseline.ratio_m_per_rad * turned,
        torque_nm=np.full(_POINTS + 1, phase.torque_nm),
    )
