"""Axial stiffness along the stroke from the stretch between the two encoders.

A spring between motor and table is stretched by what the table needs,

    R_t theta - x = C(x) F + b/2 sgn(F) + T v + e x + constant,  F = m x'' + F_guide sgn(v) - F_ext,

so the stretch under known inertia force gives the compliance C of all springs in series (5.3.1),
its reversal the lost motion 2 C F_guide + b, its part in proportion to the speed the skew T of the
linear encoder's clock, and its slope along the stroke the lead or scale error e. Where the load
turns against the motion and outdoes the guides, the play b shows by itself (`load_reversal`). The
thesis takes the same difference in its constant-acceleration test (5.2.1, Figure 5.5).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import ANGLE, EXTERNAL_FORCE, TABLE_POSITION, Floats
from ...models.machine import Machine, Quantity
from ...regression.interval_estimate import IntervalEstimate, normal_quantile, undetermined
from ...regression.linear import least_squares
from ...regression.prepared_run import DECIMATION, PreparedRun, derivative_noise_rms
from ..result import Contents, Curve
from .load_reversal import find_load_reversal

STROKE_SHARES = (0.2, 0.5, 0.8)
"""Places along the stroke at which fingerprints can be compared."""
MASS_UNKNOWN = "needs the table's mass (model.table_mass_kg)"
_REVERSAL = "turned flank"


@dataclass(frozen=True, slots=True)
class StiffnessPoint:
    """The axis at one place of its stroke."""

    position_m: float  # of the table
    stiffness: IntervalEstimate  # of all springs in series, N/m
    # of the table against a motor that is held, Hz: 1 / (2 pi sqrt(C m)); known without the mass
    locked_resonance: IntervalEstimate
    # difference of the stretch between the two directions, m: wind-up by the guide force, and
    # backlash
    lost_motion: IntervalEstimate


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessFit:
    """Quantities identified from the stretch."""

    points: tuple[StiffnessPoint, ...]  # along the stroke
    # b, m, one for the whole stroke; undetermined unless the axis brakes harder than its guides do
    # and play shows
    play: IntervalEstimate

    def curve(self, name: str, values: Sequence[IntervalEstimate], unit: str) -> Curve:
        """Curve of a quantity over the places of the points."""
        places_m = np.array([point.position_m for point in self.points])
        y = np.array([each.value for each in values])
        return Curve(name, places_m, y, "table position, m", f"{name}, {unit}")


def stretch_fit(runs: Iterable[PreparedRun], machine: Machine) -> StiffnessFit:
    """Fit of the stretch between the encoders. Raises ValueError: no stroke, or no fit."""
    if machine.axis.stroke_m is None:
        raise ValueError("axis.stroke_m is missing in the machine file")
    places_m = [share * machine.axis.stroke_m for share in STROKE_SHARES]
    return fit_stiffness(runs, places_m, machine.model.table_mass_kg)


def measure_stiffness(fit: StiffnessFit) -> Contents:
    """Stiffness and the table's resonance along the stroke."""
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"stiffness_{place}_n_per_m"] = point.stiffness
        figures[f"locked_resonance_{place}_hz"] = point.locked_resonance
    return figures, (fit.curve("stiffness", [each.stiffness for each in fit.points], "N/m"),)


def measure_backlash(fit: StiffnessFit, machine: Machine) -> Contents:
    """Lost motion along the stroke, and the play in it where the guide force is known."""
    known = "guide_force_n" in machine.model.model_fields_set
    guide_n = machine.model.guide_force_n if known else None
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"lost_motion_{place}_m"] = point.lost_motion
        figures[f"backlash_{place}_m"] = backlash(point, guide_n, fit.play)
    return figures, (fit.curve("lost motion", [each.lost_motion for each in fit.points], "m"),)


def fit_stiffness(
    runs: Iterable[PreparedRun], positions_m: Sequence[float], table_mass_kg: Quantity | None = None
) -> StiffnessFit:
    """Compliance and lost motion at given places, linear in between and beyond.

    The compliance of a screw that is fixed at one end is linear in the position (5.3.9), that of
    one fixed at both ends a parabola (5.3.10), which a few places follow. Without the mass of table
    and workpiece there is no stiffness in N/m.

    Raises ValueError: no linear encoder, positions that do not rise, too little motion.
    """
    nodes = np.asarray(positions_m, dtype=np.float64)
    if nodes.size == 0 or (np.diff(nodes) <= 0.0).any():
        raise ValueError("positions_m must rise and hold at least one place")
    runs = list(runs)
    if not runs:
        raise ValueError("no unbroken run long enough in the recording")
    loads = [_load(run, table_mass_kg) for run in runs]
    rows = [_rows(*each, nodes, table_mass_kg) for each in zip(runs, loads, strict=True)]
    design, stretch_m, noise_rms = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    noise = np.sqrt(np.mean(noise_rms**2, axis=0))
    names = [
        *(f"load at {1e3 * place:.6g} mm" for place in nodes),
        *(f"direction at {1e3 * place:.6g} mm" for place in nodes),
        *("speed", "position", "constant"),
    ]
    reversal = find_load_reversal(runs, loads, design, stretch_m)
    if reversal is not None and reversal.shown:
        names, noise = [*names, _REVERSAL], np.append(noise, 0.0)
        design = np.column_stack((design, reversal.column))
    if reversal is not None:
        design, stretch_m = design[reversal.whole], stretch_m[reversal.whole]
    fit = least_squares(names, design, stretch_m, noise)
    count, mass = len(nodes), 1.0 if table_mass_kg is None else table_mass_kg.value
    points = []
    for k, place in enumerate(nodes.tolist()):
        load = fit.interval_estimate(fit.names[k], "m/N" if table_mass_kg else "s^2")
        stiffness, resonance = stiffness_of(load, table_mass_kg), locked_resonance(load, mass)
        lost = fit.interval_estimate(fit.names[count + k], "m").scaled(2.0, "m")
        points.append(StiffnessPoint(place, stiffness, resonance, lost))
    play = undetermined("m", "no play shows where the load turns", fit.n_effective)
    if _REVERSAL in fit.names:
        play = fit.interval_estimate(_REVERSAL, "m").scaled(-1.0, "m")
    return StiffnessFit(tuple(points), play)


def _rows(
    run: PreparedRun, load: Floats, nodes: Floats, table_mass_kg: Quantity | None
) -> tuple[Floats, Floats, Floats]:
    """Regressors (n, 2 k + 3), stretch (n,) and noise (n, 2 k + 3) of the moving rows of a run."""
    table = run.channels[TABLE_POSITION]
    mass = 1.0 if table_mass_kg is None else table_mass_kg.value
    shares = _hats(table, nodes)
    forces = (shares * load[:, None], shares * np.sign(run.speed_rad_s)[:, None])
    places = (table - nodes[0], np.ones_like(table))
    columns = np.column_stack((*forces, run.rate(TABLE_POSITION), *places))
    stretch = run.settings.ratio_m_per_rad * run.channels[ANGLE] - table
    noise = np.zeros(columns.shape)
    noise[:, : len(nodes)] = shares * (mass * derivative_noise_rms(run, TABLE_POSITION, 2))
    moving = noise[::DECIMATION][run.moving[::DECIMATION]]
    return run.moving_rows(columns), run.moving_rows(stretch), moving


def _load(run: PreparedRun, table_mass_kg: Quantity | None) -> Floats:
    """Load of the spring beside the guides' friction, (n,): N; m/s^2 without the mass."""
    if TABLE_POSITION not in run.channels:
        raise ValueError(f"stiffness needs {TABLE_POSITION} beside {ANGLE} in an unbroken run")
    acceleration = run.rate(TABLE_POSITION, 2)
    if table_mass_kg is None:
        return acceleration
    load = table_mass_kg.value * acceleration
    return load - run.channels[EXTERNAL_FORCE] if EXTERNAL_FORCE in run.channels else load


def _hats(position_m: Floats, nodes: Floats) -> Floats:
    """Weights of linear interpolation, (n, k): rows sum to 1; extrapolated beyond the ends."""
    if len(nodes) == 1:
        return np.ones((len(position_m), 1))
    left = np.clip(np.searchsorted(nodes, position_m) - 1, 0, len(nodes) - 2)
    share = (position_m - nodes[left]) / (nodes[left + 1] - nodes[left])
    weights = np.zeros((len(position_m), len(nodes)))
    row = np.arange(len(position_m))
    weights[row, left], weights[row, left + 1] = 1.0 - share, share
    return weights


def backlash(
    point: StiffnessPoint, guide_force_n: Quantity | None, play: IntervalEstimate | None = None
) -> IntervalEstimate:
    """Play at one place: the lost motion less the wind-up 2 F_guide C that the guides cause, m.

    Without a known guide force it is the play that shows by itself. Where none does, the two cannot
    be told apart, and the interval runs from no play to all of the lost motion.
    """
    lost, stiffness = point.lost_motion, point.stiffness
    if play is not None and play.determined and guide_force_n is None:
        return play
    if not lost.determined:
        return undetermined("m", lost.note, lost.n_effective)
    if guide_force_n is None or not stiffness.determined or stiffness.low <= 0.0:
        note = "wind-up and play cannot be told apart without the guide force and the stiffness"
        return IntervalEstimate(math.nan, 0.0, max(lost.high, 0.0), "m", lost.n_effective, note)
    windup = 2.0 * guide_force_n.value / stiffness.value
    by_force, by_spring = 2.0 * guide_force_n.sigma, windup * stiffness.sigma
    sigma = math.hypot(lost.sigma, by_force / stiffness.value, by_spring / stiffness.value)
    value, half = lost.value - windup, normal_quantile() * sigma
    value, low, high = (max(each, 0.0) for each in (value, value - half, value + half))
    return IntervalEstimate(value, low, high, "m", lost.n_effective)


def stiffness_of(compliance: IntervalEstimate, table_mass_kg: Quantity | None) -> IntervalEstimate:
    """1 / C with the tolerance of the mass, N/m."""
    if table_mass_kg is None:
        return undetermined("N/m", MASS_UNKNOWN, compliance.n_effective)
    inverse = _reciprocal(compliance, "N/m")
    spread = normal_quantile() * table_mass_kg.tolerance
    if not inverse.low > 0.0 or spread == 0.0:
        return inverse
    below = math.hypot(inverse.value / inverse.low - 1.0, spread)
    above = math.hypot(inverse.high / inverse.value - 1.0, spread)
    return replace(inverse, low=inverse.value / (1.0 + below), high=inverse.value * (1.0 + above))


def _reciprocal(positive: IntervalEstimate, unit: str) -> IntervalEstimate:
    """1 / x where x is positive by its nature and its estimate may not be."""
    count = positive.n_effective
    if not positive.determined:
        return undetermined(unit, positive.note, count)
    if positive.high <= 0.0:
        return undetermined(unit, "no compliance seen: encoders or signs disagree", count)
    if positive.low > 0.0:
        low, high = 1.0 / positive.high, 1.0 / positive.low
        return IntervalEstimate(1.0 / positive.value, low, high, unit, count)
    value = 1.0 / positive.value if positive.value > 0.0 else math.nan
    note = "too stiff for this recording: only a lower bound is known"
    return IntervalEstimate(value, 1.0 / positive.high, math.inf, unit, count, note)


def locked_resonance(load: IntervalEstimate, mass_kg: float) -> IntervalEstimate:
    """1 / (2 pi sqrt(C m)), Hz; `load` is C, and the mass with which it was fitted cancels."""
    inverse = _reciprocal(load, "1/s^2").scaled(1.0 / mass_kg, "1/s^2")
    low, value, high = (
        math.sqrt(bound) / (2.0 * math.pi) if bound > 0.0 else bound
        for bound in (inverse.low, inverse.value, inverse.high)
    )
    return IntervalEstimate(value, low, high, "Hz", inverse.n_effective, inverse.note)
