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
from ...regression.interval_estimate import LEVEL, IntervalEstimate, normal_quantile, undetermined
from ...regression.linear import LinearFit, least_squares
from ...regression.prepared_run import PreparedRun, derivative_noise_rms
from ..result import Contents, Curve
from .load_reversal import find_load_reversal

STROKE_SHARES = (0.2, 0.5, 0.8)
"""Places along the stroke at which fingerprints can be compared."""
MASS_UNKNOWN = "needs the table's mass (model.table_mass_kg)"
_REVERSAL = "turned flank"
_CROSSED = "there is play, and it cannot be told from the guides' wind-up"


@dataclass(frozen=True, slots=True)
class StiffnessPoint:
    """The axis at one place of its stroke.

    Attributes:
        position_m: of the table.
        stiffness: of all springs in series, N/m.
        locked_resonance: of the table against a motor that is held, Hz: 1 / (2 pi sqrt(C m));
            known without the mass.
        lost_motion: difference of the stretch between the two directions, m: wind-up by the guide
            force, and backlash.
    """

    position_m: float
    stiffness: IntervalEstimate
    locked_resonance: IntervalEstimate
    lost_motion: IntervalEstimate


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessFit:
    """Quantities identified from the stretch.

    Attributes:
        points: along the stroke.
        guide_force: F_guide, N; where no play shows by itself, all lost motion counts as wind-up.
        play: b, m, one for the whole stroke; undetermined unless the axis brakes harder than its
            guides do and play shows.
        clock_skew: T, s; positive if the linear encoder is sampled late. Guide viscosity through
            the compliance is in it.
        scale_error: e, m/m; positive if the screw's lead is greater than stated.
        fit: the regression behind it.
    """

    points: tuple[StiffnessPoint, ...]
    guide_force: IntervalEstimate
    play: IntervalEstimate
    clock_skew: IntervalEstimate
    scale_error: IntervalEstimate
    fit: LinearFit

    @property
    def places_m(self) -> Floats:
        """Places of the points, (k,)."""
        return np.array([point.position_m for point in self.points])


def stretch_fit(runs: Iterable[PreparedRun], machine: Machine) -> "StiffnessFit":
    """Fit of the stretch between the encoders. Raises ValueError: no stroke, or no fit."""
    if machine.axis.stroke_m is None:
        raise ValueError("axis.stroke_m is missing in the machine file")
    places_m = [share * machine.axis.stroke_m for share in STROKE_SHARES]
    return fit_stiffness(runs, places_m, machine.model.table_mass_kg)


def measure_stiffness(fit: "StiffnessFit") -> Contents:
    """Stiffness and the table's resonance along the stroke."""
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"stiffness_{place}_n_per_m"] = point.stiffness
        figures[f"locked_resonance_{place}_hz"] = point.locked_resonance
    values = np.array([point.stiffness.value for point in fit.points])
    curve = Curve("stiffness", fit.places_m, values, "table position, m", "stiffness, N/m")
    return figures, (curve,)


def measure_backlash(fit: "StiffnessFit", machine: Machine) -> Contents:
    """Lost motion along the stroke, and the play in it where the guide force is known."""
    known = "guide_force_n" in machine.model.model_fields_set
    guide_n = machine.model.guide_force_n if known else None
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"lost_motion_{place}_m"] = point.lost_motion
        figures[f"backlash_{place}_m"] = backlash(point, guide_n, fit.play)
    values = np.array([point.lost_motion.value for point in fit.points])
    curve = Curve("lost motion", fit.places_m, values, "table position, m", "lost motion, m")
    return figures, (curve,)


def fit_stiffness(
    runs: Iterable[PreparedRun],
    positions_m: Sequence[float],
    table_mass_kg: Quantity | None = None,
) -> StiffnessFit:
    """Compliance and lost motion at given places, linear in between and beyond.

    The compliance of a screw that is fixed at one end is linear in the position (5.3.9), that of
    one fixed at both ends a parabola (5.3.10), which a few places follow.

    Args:
        runs: with both encoders.
        positions_m: rising, at least one.
        table_mass_kg: table with workpiece; without it there is no stiffness in N/m.

    Raises ValueError: no linear encoder, positions that do not rise, too little motion.
    """
    nodes = np.asarray(positions_m, dtype=np.float64)
    if nodes.size == 0 or (np.diff(nodes) <= 0.0).any():
        raise ValueError("positions_m must rise and hold at least one place")
    runs = list(runs)
    if not runs:
        raise ValueError("no unbroken run long enough in the recording")
    rows = [_rows(run, nodes, table_mass_kg) for run in runs]
    design, stretch_m, noise_rms = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    noise = np.sqrt(np.mean(noise_rms**2, axis=0))
    names = [
        *(f"load at {1e3 * place:.6g} mm" for place in nodes),
        *(f"direction at {1e3 * place:.6g} mm" for place in nodes),
        *("speed", "position", "constant"),
    ]
    loads = [_load(run, table_mass_kg) for run in runs]
    reversal = find_load_reversal(runs, loads, design, stretch_m)
    crossed = reversal is not None and not reversal.shown
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
    guide_n = undetermined("N", _CROSSED, fit.n_effective)
    if not crossed:
        guide_n = _guide_force(fit, count, table_mass_kg)
    play = undetermined("m", "no play shows where the load turns", fit.n_effective)
    if _REVERSAL in fit.names:
        play = fit.interval_estimate(_REVERSAL, "m").scaled(-1.0, "m")
    skew, scale = fit.interval_estimate("speed", "s"), fit.interval_estimate("position", "m/m")
    return StiffnessFit(tuple(points), guide_n, play, skew, scale, fit)


def _rows(
    run: PreparedRun, nodes: Floats, table_mass_kg: Quantity | None
) -> tuple[Floats, Floats, Floats]:
    """Regressors (n, 2 k + 3), stretch (n,) and noise (n, 2 k + 3) of the moving rows of a run."""
    if TABLE_POSITION not in run.channels:
        raise ValueError(f"stiffness needs {TABLE_POSITION} beside {ANGLE} in an unbroken run")
    table = run.channels[TABLE_POSITION]
    mass = 1.0 if table_mass_kg is None else table_mass_kg.value
    load = _load(run, table_mass_kg)
    shares = _hats(table, nodes)
    columns = np.column_stack(
        (
            shares * load[:, None],
            shares * np.sign(run.speed_rad_s)[:, None],
            run.rate(TABLE_POSITION),
            table - nodes[0],
            np.ones_like(table),
        )
    )
    stretch = run.settings.ratio_m_per_rad * run.channels[ANGLE] - table
    noise = np.zeros(columns.shape)
    noise[:, : len(nodes)] = shares * (mass * derivative_noise_rms(run, TABLE_POSITION, 2))
    return (
        run.moving_rows(columns),
        run.moving_rows(stretch),
        noise[:: run.settings.decimation][run.moving[:: run.settings.decimation]],
    )


def _load(run: PreparedRun, table_mass_kg: Quantity | None) -> Floats:
    """Load of the spring beside the guides' friction, (n,): N; m/s^2 without the mass."""
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


def _guide_force(fit: LinearFit, count: int, table_mass_kg: Quantity | None) -> IntervalEstimate:
    """F_guide from the ratios of the direction's to the load's coefficients, N."""
    if table_mass_kg is None:
        return undetermined("N", MASS_UNKNOWN, fit.n_effective)
    reversal = fit.names.index(_REVERSAL) if _REVERSAL in fit.names else None
    half_play = 0.0 if reversal is None else -0.5 * float(fit.coefficients[reversal])
    ratios, gradients = [], []
    for k in range(count):
        load = fit.interval_estimate(fit.names[k], "m/N")
        if not (load.determined and load.low > 0.0):
            continue
        ratio = (float(fit.coefficients[count + k]) - half_play) / load.value
        gradient = np.zeros(len(fit.names))
        gradient[k], gradient[count + k] = -ratio / load.value, 1.0 / load.value
        if reversal is not None:
            gradient[reversal] = 0.5 / load.value
        ratios.append(ratio)
        gradients.append(gradient)
    covariance = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0)
    if not ratios or any(fit.names[k] in fit.notes for k in range(2 * count)):
        return undetermined("N", "the compliance is undetermined", fit.n_effective)
    weights = np.array([1.0 / float(each @ covariance @ each) for each in gradients])
    weights /= np.sum(weights)
    whole = weights @ np.array(gradients)
    value = float(weights @ np.array(ratios))
    sigma = math.hypot(math.sqrt(whole @ covariance @ whole), value * table_mass_kg.tolerance)
    half = normal_quantile() * sigma
    note = "" if reversal is not None else f"{100 * LEVEL:g} % interval if there is no play"
    return IntervalEstimate(value, value - half, value + half, "N", fit.n_effective, note)


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
    sigma = math.hypot(
        lost.sigma,
        2.0 * guide_force_n.sigma / stiffness.value,
        windup * stiffness.sigma / stiffness.value,
    )
    value, half = lost.value - windup, normal_quantile() * sigma
    return IntervalEstimate(
        max(value, 0.0), max(value - half, 0.0), max(value + half, 0.0), "m", lost.n_effective
    )


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
