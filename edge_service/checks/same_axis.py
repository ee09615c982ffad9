"""Check that recordings can be of one axis, by what neither warm-up nor oil nor a load changes."""

import itertools
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.samples import Floats
from ..regression.run import Integers, Run

LEAST_TRAVEL_M, LONG_TRAVEL_M = 5e-3, 0.1
"""A file that stays within these says nothing of the lead, or nothing that reaches further."""
LEAD_SHARE = 0.02
LAG_RATIO = 1.8
"""The same for a setpoint, which leads its axis: how far depends on its controller."""
LOST_MOTION_M = 2e-4
"""Play, growth and wobble: by so much table and motor part on one axis, wherever it is."""
ZERO_M = 5e-4
INERTIA_RATIO, FRICTION_RATIO = 1.8, 4.0
"""Beyond what compliance and saturation, and what warming up, oil and forces, do to one axis."""
_SIGMAS = 4.0
_MOST_ROWS = 20_000
_BLOCK_ROWS = 60
_LEAST_BLOCKS = 10
"""Some five seconds of motion: in less a push, or an odd load, passes for friction."""
_LEAST_ROWS = 30
_OTHER = -99


def by_recording(runs: Iterable[Run]) -> dict[int, list[Run]]:
    """Runs of each recording, in their order."""
    found: dict[int, list[Run]] = {}
    for run in runs:
        found.setdefault(run.recording, []).append(run)
    return found


@dataclass(frozen=True, slots=True)
class Travel:
    """Travel of the motor in a file, and that of table and setpoint along with it.

    Attributes:
        lead, setpoint_lead: of table and setpoint over that of the machine file; NaN if unknown.
        travel_m, middle_m: range of the motor's angle, and its median.
        zero_m: median of table position minus that of the angle.
    """

    lead: float
    setpoint_lead: float
    travel_m: float
    middle_m: float
    zero_m: float

    @property
    def lead_reach(self) -> float:
        """Share by which a lead may seem off on so short a way."""
        return LEAD_SHARE + LOST_MOTION_M / max(self.travel_m, LEAST_TRAVEL_M)


@dataclass(frozen=True, slots=True)
class Dynamics:
    """Inertia and friction of an axis, as the torque of a file shows them.

    Attributes:
        inertia_kg_m2: with its standard deviation `sigma_kg_m2`.
        friction_nm: octave of the motor's speed in rad/s -> torque along the motion, and its
            standard deviation.
    """

    inertia_kg_m2: float
    sigma_kg_m2: float
    friction_nm: Mapping[int, tuple[float, float]]


def inconsistency(
    runs: Sequence[Run], ratio_m_per_rad: float, names: Sequence[str] = ()
) -> str | None:
    """Reason why two recordings cannot be of one axis, in a line; None if all can be.

    Args:
        ratio_m_per_rad: of the machine file.
        names: of the recordings, by their number.
    """
    called = dict(enumerate(names))
    fits = [
        (called.get(k, f"recording {k + 1}"), _travel(each, ratio_m_per_rad), _dynamics(each))
        for k, each in sorted(by_recording(runs).items())
    ]
    for (one, travel, dynamics), (other, way, torque) in itertools.combinations(fits, 2):
        why = _of_travel(travel, way, 2.0 * np.pi * ratio_m_per_rad)
        if not why and dynamics is not None and torque is not None:
            why = _of_dynamics(dynamics, torque)
        if why:
            return f"{one} and {other} are not from the same axis: {why}"
    return None


def _of_travel(one: Travel, other: Travel, lead_m: float) -> str:
    reach = max(one.lead_reach, other.lead_reach)
    late = 1.0 - 1.0 / LAG_RATIO
    leads = (one.lead, other.lead, reach), (one.setpoint_lead, other.setpoint_lead, late)
    for a, b, most in leads:
        if abs(a - b) > most * max(abs(a), abs(b)):
            return f"lead {1e3 * lead_m * a:.4g} mm against {1e3 * lead_m * b:.4g} mm"
    longer = max(one, other, key=lambda each: each.travel_m)
    # an error of the lead that both share parts the encoders with the way, not the zeros
    slope = longer.lead - 1.0 if longer.travel_m > LONG_TRAVEL_M else 0.0
    apart_m = abs(one.zero_m - other.zero_m - slope * (one.middle_m - other.middle_m))
    if apart_m > ZERO_M:
        return f"at one motor angle their table positions are {1e3 * apart_m:.3g} mm apart"
    return ""


def _of_dynamics(one: Dynamics, other: Dynamics) -> str:
    low, high = sorted((one, other), key=lambda each: each.inertia_kg_m2)
    apart = high.inertia_kg_m2 - INERTIA_RATIO * low.inertia_kg_m2
    if apart > _SIGMAS * math.hypot(high.sigma_kg_m2, INERTIA_RATIO * low.sigma_kg_m2):
        return f"inertia {one.inertia_kg_m2:.3g} kg m2 against {other.inertia_kg_m2:.3g} kg m2"
    ratio = max(_times(one, other), _times(other, one))
    if ratio > FRICTION_RATIO:
        return f"friction at the same speed differs by a factor of at least {ratio:.2g}"
    return ""


def _times(high: Dynamics, low: Dynamics) -> float:
    """Least factor by which friction is higher, in the middle of the speeds that both run."""
    ratios = [
        (level - _SIGMAS * sigma) / max(less + _SIGMAS * off, 1e-12)
        for octave, (level, sigma) in high.friction_nm.items()
        for less, off in [low.friction_nm.get(octave, (math.inf, 0.0))]
        if math.isfinite(less)
    ]
    return statistics.median(ratios or [1.0])


def _travel(runs: Sequence[Run], ratio_m_per_rad: float) -> Travel:
    every = max(sum(len(run.motion) for run in runs) // _MOST_ROWS, 1)
    angle = ratio_m_per_rad * _joined([run.motion.angle_rad for run in runs], every)
    speed = _joined([run.motion.speed_rad_s for run in runs], every)
    table = _joined([run.transmission_m for run in runs], every)
    setpoint = _joined([run.setpoint_m for run in runs], every) - angle
    travel_m, middle_m = float(np.ptp(angle)), float(np.median(angle))
    # a late channel follows the speed, and so does a setpoint ahead of its axis
    known = np.column_stack([angle - middle_m, speed, np.ones_like(angle)])
    leads = [
        1.0 + float(np.linalg.lstsq(known, apart, rcond=None)[0][0])
        if travel_m >= LEAST_TRAVEL_M and np.isfinite(apart).all()
        else math.nan
        for apart in (table, setpoint)
    ]
    return Travel(leads[0], leads[1], travel_m, middle_m, float(np.median(table)))


def _joined(parts: Sequence[Floats | None], every: int) -> Floats:
    """Every so-many-th value of all parts; one NaN where one of them was not recorded."""
    known = [part[::every] for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else np.array([math.nan])


def _dynamics(runs: Sequence[Run]) -> Dynamics | None:
    """Torque = J a + offset + s(v) T(octave of |v|), by least squares over the moving rows."""
    runs = [run for run in runs if run.has_torque and run.moving.any()]
    if not runs:
        return None
    parts = []  # through one low-pass, (n,) each
    for run in runs:
        motion, rows = run.motion, run.compared_rows
        curves = (motion.torque_nm, motion.acceleration_rad_s2, motion.direction)
        filtered = [run.resting_zero(curve)[rows] for curve in curves]
        parts.append((*filtered, run.at_rows(motion.speed_rad_s)[rows]))
    torque, acceleration, direction, speed = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    octave = np.round(np.log2(np.maximum(np.abs(speed), 1e-3))).astype(int)
    octave[~np.isin(octave, _both_ways(octave, direction))] = _OTHER
    there = _both_ways(octave, direction)
    columns = np.column_stack(
        [acceleration, np.ones_like(speed), *(direction * (octave == k) for k in there)]
    )
    kept = np.isin(octave, there)
    columns, torque = columns[kept], torque[kept]
    if (
        len(columns) < _LEAST_BLOCKS * _BLOCK_ROWS
        or np.linalg.matrix_rank(columns) < columns.shape[1]
    ):
        return None
    values, sigma = _fitted(columns, torque)
    if any(run.misses_acceleration for run in runs):
        sigma[0] = math.inf
    levels = zip(values[2:].tolist(), sigma[2:].tolist(), strict=True)
    friction = {
        k: level for k, level in zip(there, levels, strict=True) if k != _OTHER and level[0] > 0.0
    }
    return Dynamics(float(values[0]), float(sigma[0]), friction)


def _both_ways(octave: Integers, direction: Floats) -> list[int]:
    """Octaves run in both directions: friction of others could be a constant load."""
    return [
        k
        for k in np.unique(octave).tolist()
        if min(np.sum((octave == k) & (direction * way > 0.5)) for way in (1, -1)) >= _LEAST_ROWS
    ]


def _fitted(columns: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Least squares, (p,), with deviations that allow for rows of a block to go together, (p,)."""
    inverse = np.linalg.inv(columns.T @ columns)
    found: Floats = inverse @ (columns.T @ values)
    scores = columns * (values - columns @ found)[:, None]
    blocks = np.add.reduceat(scores, np.arange(0, len(scores), _BLOCK_ROWS))
    sigma: Floats = np.sqrt(np.diag(inverse @ (blocks.T @ blocks) @ inverse))
    return found, sigma
