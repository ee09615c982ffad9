"""Curves over a motion that an effect's entry leaves out: heat, late friction, play by load."""

from collections.abc import Callable

import numpy as np
from scipy import signal

from ...messages.samples import Floats
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.hysteresis import bristle_share, play

Curve = Callable[[Motion, Baseline], Floats]
_HEAT_CELLS = 40


def power_law_friction(power: float) -> Curve:
    return lambda motion, _: motion.direction * np.power(np.abs(motion.speed_rad_s) / 100.0, power)


def presliding_stribeck(speed_rad_s: float) -> Curve:
    """Breakaway that builds up over the first micrometre, as bristles let it."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        held = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, 1e-6)
        risen: Floats = held * np.exp(-np.abs(motion.speed_rad_s) / speed_rad_s)
        return risen

    return curve


def delayed_friction(reach_m: float, share: float) -> Curve:
    """The table's friction comes late where the motor has to turn before the table moves."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        held = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, reach_m)
        return share * baseline.coulomb_nm * (held - motion.direction)

    return curve


def load_windup(compliance_m_per_n: float, share: float) -> Curve:
    def curve(motion: Motion, baseline: Baseline) -> Floats:
        load = baseline.table_inertia_kg_m2 * motion.acceleration_rad_s2
        rubbed = baseline.coulomb_nm * motion.approach
        rubbed = rubbed + baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        load = load + share * rubbed
        return -compliance_m_per_n * load / baseline.ratio_m_per_rad

    return curve


def heat(motion: Motion, time_constant_s: float) -> Floats:
    """First-order warmth of an axis that its own motion heats, 1 at the mean when warm, (n,)."""
    speed = np.abs(motion.speed_rad_s)
    period_s = float(motion.time_s[1] - motion.time_s[0])
    keep = float(np.exp(-period_s / time_constant_s))
    mean = max(float(speed.mean()), 1e-9)
    return np.asarray(signal.lfilter([(1.0 - keep) / mean], [1.0, -keep], speed))


def warmup_coulomb(tau_s: float) -> Curve:
    return lambda motion, _: motion.direction * np.exp(-2.0 * heat(motion, tau_s))


def warmup_viscous(tau_s: float) -> Curve:
    return lambda motion, _: motion.speed_rad_s * np.exp(-2.0 * heat(motion, tau_s))


def thermal_growth(tau_s: float) -> Curve:
    return lambda motion, _: motion.position_m * heat(motion, tau_s)


def bearing_growth(tau_s: float) -> Curve:
    """Growth of what lies between the fixed bearing and the nearest place of the nut."""
    return lambda motion, _: heat(motion, tau_s)


def windup_by_loads(dry: float, viscous: float) -> tuple[Curve, Curve]:
    """Wind-up by a compliance that is even, and by one that grows with the position.

    The spring carries a share of the inertia and so many times as great a share of the frictions:
    no load is friction alone.
    """

    def load(motion: Motion, baseline: Baseline) -> Floats:
        rubbed = dry * baseline.coulomb_nm * motion.approach
        rubbed = rubbed + viscous * baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        return -baseline.inertia_kg_m2 * motion.acceleration_rad_s2 - rubbed

    return load, lambda motion, baseline: motion.position_m * load(motion, baseline)


def local_growth(tau_s: float) -> Curve:
    """Growth of a screw that is heated where the nut runs, without conduction."""

    def curve(motion: Motion, _baseline: Baseline) -> Floats:
        low, high = float(motion.position_m.min()), float(motion.position_m.max())
        width = max(high - low, 1e-6) / _HEAT_CELLS
        step = max(round(0.05 / float(motion.time_s[1] - motion.time_s[0])), 1)
        position, speed = motion.position_m[::step], np.abs(motion.speed_rad_s[::step])
        cell = np.clip(((position - low) / width).astype(int), 0, _HEAT_CELLS - 1)
        keep = float(np.exp(-step * float(motion.time_s[1] - motion.time_s[0]) / tau_s))
        gained = np.zeros((len(cell), _HEAT_CELLS))
        gained[np.arange(len(cell)), cell] = speed * (1.0 - keep)
        warm = signal.lfilter([1.0], [1.0, -keep], gained, axis=0)
        below = np.cumsum(warm, axis=1) - 0.5 * warm
        grown = below[np.arange(len(cell)), cell] * width
        scale = max(float(np.abs(grown).max()), 1e-30)
        reached: Floats = grown / scale * max(high, 1e-3)
        spread: Floats = np.interp(motion.time_s, motion.time_s[::step], reached)
        return spread

    return curve


def travel_wave(low_m: float, span_m: float, order: int) -> Curve:
    return lambda motion, _: np.cos(order * np.pi * (motion.position_m - low_m) / span_m)


def load_side_play(width_m: float) -> Curve:
    """Play whose flank is that of the load: a table that brakes leans on the other flank."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        travel = baseline.ratio_m_per_rad * motion.angle_rad
        load = baseline.table_inertia_kg_m2 * motion.acceleration_rad_s2
        load = load + 0.5 * baseline.coulomb_nm * motion.approach
        ahead = np.where(load * motion.approach < 0.0, motion.approach, 0.0).astype(np.int8)
        return play(travel, width_m, ahead) - travel

    return curve
