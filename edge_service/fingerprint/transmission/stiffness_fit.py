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
from dataclasses import dataclass

import numpy as np

from ...messages.channels import ANGLE, EXTERNAL_FORCE, TABLE_POSITION
from ...messages.samples import Floats
from ...models.machine import Quantity
from ...regression.interval_estimate import LEVEL, IntervalEstimate, normal_quantile, undetermined
from ...regression.linear import LinearFit, least_squares
from ...regression.prepared_run import PreparedRun, derivative_noise_rms
from .load_reversal import find_load_reversal
from .stiffness_point import MASS_UNKNOWN, StiffnessPoint, locked_resonance, stiffness_of

_REVERSAL = "turned flank"
_CROSSED = "there is play, and it cannot be told from the guides' wind-up"


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

    Raises:
        ValueError: one line; no linear encoder, positions that do not rise, too little motion.
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
    names = _names(nodes)
    reversal = find_load_reversal(
        runs, [_load(run, table_mass_kg) for run in runs], design, stretch_m
    )
    if reversal is not None and reversal.shown:
        names, noise = [*names, _REVERSAL], np.append(noise, 0.0)
        design = np.column_stack((design, reversal.column))
    if reversal is not None:
        design, stretch_m = design[reversal.whole], stretch_m[reversal.whole]
    fit = least_squares(names, design, stretch_m, noise)
    points = tuple(_station(fit, k, nodes, table_mass_kg) for k in range(len(nodes)))
    return StiffnessFit(
        points,
        (
            undetermined("N", _CROSSED, fit.n_effective)
            if reversal is not None and not reversal.shown
            else _guide_force(fit, len(nodes), table_mass_kg)
        ),
        _play(fit),
        fit.interval_estimate("speed", "s"),
        fit.interval_estimate("position", "m/m"),
        fit,
    )


def _names(nodes: Floats) -> list[str]:
    """Names of the regressors, load and direction by place: the first 2 k are addressed by it."""
    return [
        *(f"load at {1e3 * place:.6g} mm" for place in nodes),
        *(f"direction at {1e3 * place:.6g} mm" for place in nodes),
        "speed",
        "position",
        "constant",
    ]


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


def _station(
    fit: LinearFit, index: int, nodes: Floats, table_mass_kg: Quantity | None
) -> StiffnessPoint:
    load = fit.interval_estimate(fit.names[index], "m/N" if table_mass_kg else "s^2")
    direction = fit.interval_estimate(fit.names[len(nodes) + index], "m")
    mass = table_mass_kg.value if table_mass_kg else 1.0
    return StiffnessPoint(
        position_m=float(nodes[index]),
        stiffness=stiffness_of(load, table_mass_kg),
        locked_resonance=locked_resonance(load, mass),
        lost_motion=direction.scaled(2.0, "m"),
    )


def _play(fit: LinearFit) -> IntervalEstimate:
    """Width of the play, m: the stretch falls by it where the flank turns."""
    if _REVERSAL not in fit.names:
        return undetermined("m", "no play shows where the load turns", fit.n_effective)
    return fit.interval_estimate(_REVERSAL, "m").scaled(-1.0, "m")


def _guide_force(fit: LinearFit, count: int, table_mass_kg: Quantity | None) -> IntervalEstimate:
    """F_guide from the ratios of the direction's to the load's coefficients, N.

    Each place gives (d - b/2) / C. They are averaged with the weights of their variances; the error
    of the mean is that of all coefficients together, which are not independent.
    """
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
