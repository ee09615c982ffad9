"""Noise of a session: what no fit can explain, and how much of a residual matters.

What smooth functions of the motion say of the gap in another block of time is no noise, nor is what
comes again at the same place at the same speed. Bursts, such as those of a force, are not either.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy import stats
from scipy.spatial import KDTree

from ...messages.samples import Floats, Integers
from ...models.machine import Machine
from ...regression import chance_of_misfit
from ...regression.linear import effective_size
from ..session.recordings import STEPS, STRETCH
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session, rms
from .structure import predicted_structure, structure_of_gap

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
_LEAST_EFFECTIVE = 40.0
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""
TOLERANCE_OF_FLOOR = 1.0
"""Gap beyond its floor that nobody acts on where the machine file states none, over the floor."""
MOST_OF_TORQUE = 0.1
"""Of the torque in motion: a gap beyond that is acted on, however much else is noise."""
TOLERANCE_OF_TORQUE = 1e-3
"""The same over the greatest torque: drives state their torque in such steps."""
INTERPOLATION_M = 5e-8
"""Error of interpolation within a signal period of a good linear encoder (assumption)."""
_PIECE_ROWS = 24
_MOST_SPREAD = 0.6
"""Of the logarithm of the pieces' root mean squares; beyond it pieces are not of one kind."""
_SAME_RAD, _SAME_SPEED, _SAME_ACCELERATION = 0.05, 0.1, 0.3
"""Rows are repeats within so much of the motor's angle, and so much in log(1 + .) of the others."""
_SLOW_RAD_S, _SOFT_RAD_S2 = 1.0, 50.0
_LEAST_REPEATS, _MOST_REPEATS = 200, 4000
_REPEATS_MAY_MISS = 1.3
"""Repeats are few and lie where the axis goes most: by so much they may be too quiet."""
_MORE_THAN_NOISE = 1.5
"""Root mean square over the floor from which on a rest shows nothing of its noise."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise that a fit cannot explain, by channel.

    Attributes:
        floor: root mean square that a healthy axis leaves.
        tolerance: root mean square that nobody needs to know the cause of.
        effective: independent observations among the rows; bounded, for the library approximates.
        discrepancy: root mean square below which one fit is no better than another.
    """

    floor: Mapping[str, float]
    tolerance: Mapping[str, float]
    effective: Mapping[str, float]
    discrepancy: Mapping[str, float]

    @classmethod
    def of_gap(cls, session: Session, machine: Machine) -> Self:
        """Noise as the gap itself shows it, before anything is fitted."""
        gaps = {name: rows.gap for name, rows in session.channels.items()}
        levels, _ = noise_floor(session, gaps, structure_of_gap(session))
        # a recording of an ailing machine says nothing of how quiet the healthy one is
        floor = {name: session.healthy_floor.get(name, each) for name, each in levels.items()}
        return cls(
            floor=floor,
            tolerance=stated_tolerance(machine, floor, session.torque_rms_nm),
            effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
            discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
        )

    def of_residual(self, session: Session, machine: Machine, left: Mapping[str, Floats]) -> Self:
        """Noise as the residual of a fit shows it: independent observations, and a lower floor.

        Args:
            left: residual by channel, (n,).
        """
        levels, noise = noise_floor(session, left)
        known = session.healthy_floor
        floor = {n: min(known.get(n, levels[n]), each) for n, each in self.floor.items()}
        tolerance = stated_tolerance(machine, floor, session.torque_rms_nm)
        effective = {}
        for name, each in noise.items():
            # structure, or bursts, hide how the noise goes on
            is_hidden = rms(each) >= _MORE_THAN_NOISE * levels[name]
            independent = math.inf if is_hidden else effective_size(each)
            effective[name] = float(np.clip(independent, _LEAST_EFFECTIVE, MOST_EFFECTIVE))
        return replace(self, effective=effective, floor=floor, tolerance=tolerance)

    def beyond(self, channel: str, rms: float) -> float:
        """Part of a root mean square that is not the floor's."""
        return math.sqrt(max(rms**2 - self.floor[channel] ** 2, 0.0))

    def matters(self, channel: str, rms: float) -> bool:
        """Excess of a root mean square over the floor by more than the tolerance."""
        return self.beyond(channel, rms) > self.tolerance[channel]

    def chance(self, channel: str, rms: float) -> float:
        """Chance that a healthy axis, with floor and tolerance, leaves as much: of an F-test."""
        healthy = self.floor[channel] ** 2 + self.tolerance[channel] ** 2
        return chance_of_misfit(rms**2, healthy, self.effective[channel])

    def variance(self, channel: str, rms: float) -> float:
        """Variance of an observation by a fit that leaves a root mean square."""
        return rms**2 + self.discrepancy[channel] ** 2

    def unexplained_shares(
        self, session: Session, left_rms: Mapping[str, float]
    ) -> dict[str, float]:
        """Share of each channel's energy above the floor that is left, `left_rms` by channel.

        A remainder within the tolerance counts as none.
        """
        found = {}
        for name, rows in session.channels.items():
            above, left = self.beyond(name, rows.rms), left_rms[name]
            counts = above > 0.0 and self.matters(name, left)
            found[name] = min((self.beyond(name, left) / above) ** 2, 1.0) if counts else 0.0
        return found


def stated_tolerance(
    machine: Machine, floor: Mapping[str, float], torque_nm: float
) -> dict[str, float]:
    """Gap beyond the floor that nobody acts on, by channel.

    As the machine file states it; otherwise as much as the floor, in the torque no more than a
    tenth of that in motion and no less than a thousandth of the drive's greatest, and what a
    linear encoder's own interpolation makes.

    Args:
        torque_nm: root mean square of the torque in motion.
    """
    stated = {
        TORQUE_GAP: machine.tolerance.torque_nm,
        TRANSMISSION_GAP: machine.tolerance.position_m,
    }
    least = {
        TORQUE_GAP: TOLERANCE_OF_TORQUE * (machine.axis.max_torque_nm or 0.0),
        TRANSMISSION_GAP: INTERPOLATION_M,
    }
    most = {TORQUE_GAP: MOST_OF_TORQUE * torque_nm}
    return {
        name: stated[name]
        or max(min(TOLERANCE_OF_FLOOR * each, most.get(name, math.inf)), least[name])
        for name, each in floor.items()
    }


def steps_nm(session: Session) -> float:
    """Root mean square that coarse steps of the torque leave in it, N m; otherwise 0."""
    return max(run.noise.get(STEPS, 0.0) for run in session.runs)


def noise_floor(
    session: Session,
    left: Mapping[str, Floats],
    structure: Mapping[str, Floats] | None = None,
) -> tuple[dict[str, float], dict[str, Floats]]:
    """Root mean square of the noise of a residual, and what holds it, (n,), by channel.

    Args:
        left: residual, by channel, (n,).
        structure: what is predicted of it, where that is known.
    """
    structure = predicted_structure(session, left) if structure is None else structure
    levels, noise = {}, {}
    for name, each in left.items():
        rest, rows = each - structure[name], session.channels[name]
        again = _repeated_rms(rows, rest, session.baseline.ratio_m_per_rad, session.fold[name])
        least = steps_nm(session) if name == TORQUE_GAP else 0.0
        most = math.inf if name == TORQUE_GAP else _encoders_rms(session)
        levels[name] = max(min(ordinary_rms(rest), _REPEATS_MAY_MISS * again, most), least)
        noise[name] = rest
    return levels, noise


def _encoders_rms(session: Session) -> float:
    """Most that two encoders read apart by chance, m: what is smooth between samples is not."""
    noise_m = max(r.noise.get(STRETCH, 0.0) * math.hypot(*r.low_pass.taps) for r in session.runs)
    return math.hypot(_REPEATS_MAY_MISS * noise_m, INTERPOLATION_M)


def ordinary_rms(values: Floats) -> float:
    """Root mean square of a series (n,), as the middle half of its pieces shows it.

    The pieces' own root mean squares are taken for log-normal.
    """
    whole = rms(values)
    count = len(values) // _PIECE_ROWS
    if count < 4:
        return whole
    pieces = values[: count * _PIECE_ROWS].reshape(count, _PIECE_ROWS)
    logarithm = 0.5 * np.log(np.maximum(np.mean(pieces**2, axis=1), 1e-300))
    low, high = np.quantile(logarithm, (0.25, 0.75))
    spread = min(float(stats.iqr(logarithm, scale="normal")), _MOST_SPREAD)
    return min(float(np.exp(0.5 * (low + high) + spread**2)), whole)


def _repeated_rms(rows: Rows, values: Floats, ratio_m_per_rad: float, fold: Integers) -> float:
    """Root mean square of a series (n,) as its repeats differ; infinite where they are too few."""
    known = rows.variables
    pace = paces(known["motor_speed_rad_s"], known["motor_acceleration_rad_s2"])
    state = np.column_stack((known["table_position_m"] / ratio_m_per_rad / _SAME_RAD, pace))
    even, odd = np.flatnonzero(fold % 2 == 0), np.flatnonzero(fold % 2 == 1)
    apart, nearest = KDTree(state[odd]).query(state[even], distance_upper_bound=1.0)
    order = np.argsort(apart)[:_MOST_REPEATS]
    order = order[np.isfinite(apart[order])]
    if len(order) < _LEAST_REPEATS:
        return math.inf
    differ = values[even[order]] - values[odd[nearest[order]]]
    return float(np.median(np.abs(differ)) / stats.norm.ppf(0.75) / np.sqrt(2.0))


def paces(speed_rad_s: Floats, acceleration_rad_s2: Floats) -> Floats:
    """Speed and acceleration as repeats of one another are near in, (n, 2)."""
    speed = np.sign(speed_rad_s) * np.log1p(np.abs(speed_rad_s) / _SLOW_RAD_S)
    hard = np.sign(acceleration_rad_s2) * np.log1p(np.abs(acceleration_rad_s2) / _SOFT_RAD_S2)
    return np.column_stack((speed / _SAME_SPEED, hard / _SAME_ACCELERATION))
