"""Series compliance under inertia force, from a healthy axis with two encoders (eq. 5.3.1)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from .phases import Noise, RegressionFit, SteadyPhases, robust_regression

LEAD_NODES, NODES_PER_TURN = 40, 4
"""Nodes of the maps along the stroke, and their maximum per turn of the screw."""
LEAD_SIGMA_M = 5e-6
WIND_UP_SIGMA_M = 2e-7
"""Standard deviations of the maps from one end of the stroke to the other."""
_NONE = 1e-12
"""Prior of a parameter that is held at zero."""
BOW_SIGMA = 0.3
"""Of the compliance at the ends of the stroke: a screw that both ends hold is stiffer there."""
_LOADS = 5
"""Parameters of the fit before those of `_Beside`: loads, change of the slope, bow."""


@dataclass(frozen=True, slots=True)
class SeriesCompliance:
    """Parameters of the series compliance, per acceleration of the table instead of force."""

    reference_m: float
    per_acceleration_s2: float
    slope_per_m: float
    bow_per_m2: float
    sigma_s2: float
    slope_sigma: float
    reversal_m: float
    per_speed_s: float
    skew_s: float
    lead_map_m: Floats
    wind_up_map_m: Floats
    map_sigma_m: Floats
    noise: Noise


@dataclass(frozen=True, slots=True)
class _Seen:
    """Stretch and its possible causes, as columns."""

    phases: SteadyPhases  # rows with both encoders, n of them
    stretch_m: Floats  # of the motor's way over the table's, from its mean in a recording, (n,)
    stroke_m: float
    reference_m: float  # place along the screw at which the compliance is given
    loads: Floats  # forces as accelerations of the table, direction and speed, (n, 3)
    sloped: bool  # the way is long enough to resolve the change of the compliance along it
    pieces: int  # of the maps along the stroke

    @property
    def away_m(self) -> Floats:
        """Places from the reference, (n,)."""
        return self.phases.table_m - self.reference_m


@dataclass(frozen=True, slots=True)
class _Beside:
    """Shifts of the table without force: clocks, warmth, errors of the lead.

    Those of the maps are steps from node to node, so that a place where the axis has not been is as
    its nearest neighbour.
    """

    columns: Floats  # (n, q)
    sigma: Floats  # of their priors, (q,)
    drifts: int  # number of columns of drift
    visited: Floats  # share of the rows at each node of the maps, (k,)

    @property
    def maps(self) -> tuple[slice, slice]:
        """Places of both maps among all parameters of the fit."""
        first, count = _LOADS + 1 + self.drifts, len(self.visited)
        return slice(first, first + count), slice(first + count, first + 2 * count)


def fit_series_compliance(
    phases: SteadyPhases, machine: Machine, nut_softness: Callable[[Floats, float], Floats]
) -> SeriesCompliance | None:
    """Fit the series compliance; None with one encoder, or where nothing stretches."""
    missing = np.isnan(phases.table_m + phases.angle_rad)
    if missing.mean() > 0.5:
        return None
    seen = _seen(phases.at(~missing), machine)
    beside = _beside(seen)
    slope, bow, fit = _series_fit(seen, beside, nut_softness)
    if fit.value[0] < 3.0 * fit.sigma[0]:
        return None
    lead, wind_up = (fit.value[each].cumsum() for each in beside.maps)
    return SeriesCompliance(
        reference_m=seen.reference_m,
        per_acceleration_s2=float(fit.value[0]),
        slope_per_m=slope,
        bow_per_m2=bow,
        sigma_s2=float(fit.sigma[0]),
        slope_sigma=float(fit.sigma[3] / fit.value[0]),
        reversal_m=float(fit.value[1]),
        per_speed_s=float(fit.value[2]) if seen.sloped else 0.0,
        skew_s=float(fit.value[5]) + (0.0 if seen.sloped else float(fit.value[2])),
        lead_map_m=lead,
        wind_up_map_m=wind_up,
        map_sigma_m=_map_sigma_m(beside, fit),
        noise=fit.noise,
    )


def _map_sigma_m(beside: _Beside, fit: RegressionFit) -> Floats:
    """Standard deviation of both maps at their nodes, (k,).

    Against the straight line through where the axis has been, for the zeros of the encoders and the
    growth of the screw hold that as well.
    """
    count = len(beside.visited)
    line = np.vander(np.linspace(-1.0, 1.0, count), 2)
    weighed = line.T * beside.visited
    nodes = np.tri(count) - line @ np.linalg.lstsq(weighed @ line, weighed @ np.tri(count))[0]
    variance = np.zeros(count)
    for each in beside.maps:
        variance += np.diag(nodes @ fit.covariance[each, each] @ nodes.T)
    return np.sqrt(variance)


def _seen(phases: SteadyPhases, machine: Machine) -> _Seen:
    ratio, x = machine.transmission_ratio_m_per_rad, phases.table_m
    stroke = machine.axis.stroke_m or float(x.max())
    middle = x.min() < 0.5 * stroke < x.max()
    acceleration, speed = ratio * phases.acceleration_rad_s2, ratio * phases.speed_rad_s
    stretch_m, index = ratio * phases.angle_rad - x, np.unique(phases.run, return_inverse=True)[1]
    middle_m = np.bincount(index, stretch_m) / np.bincount(index)  # zeros may be metres apart
    return _Seen(
        phases=phases,
        stretch_m=stretch_m - middle_m[index],
        stroke_m=stroke,
        reference_m=0.5 * stroke if middle else float(np.median(x)),
        loads=np.column_stack([acceleration, phases.direction, speed]),
        sloped=bool(np.ptp(x) > 0.2 * stroke),
        pieces=min(LEAD_NODES, max(round(NODES_PER_TURN * stroke / machine.axis.lead_m), 1)),
    )


def _beside(seen: _Seen) -> _Beside:
    phases, stroke = seen.phases, seen.stroke_m
    drift = _drift_columns(phases.run, phases.time_s, seen.away_m)
    nodes = np.linspace(0.0, stroke, seen.pieces + 1)
    level = float(np.std(seen.stretch_m)) or 1e-9
    lead = _hats(phases.table_m, nodes)
    steps = lead[:, ::-1].cumsum(axis=1)[:, ::-1]
    each = np.ones(len(nodes))
    each[1:] /= math.sqrt(seen.pieces)
    sigma = [
        np.array([1e-3]),
        np.full(drift.shape[1], 1e3 * level),
        min(level, LEAD_SIGMA_M) * each,
        min(level, WIND_UP_SIGMA_M) * each,
    ]
    columns = [seen.loads[:, 2], drift, steps, phases.direction[:, None] * steps]
    visited = lead.sum(axis=0) / len(lead)
    return _Beside(np.column_stack(columns), np.concatenate(sigma), drift.shape[1], visited)


def _series_fit(
    seen: _Seen, beside: _Beside, nut_softness: Callable[[Floats, float], Floats]
) -> tuple[float, float, RegressionFit]:
    """Fit of all forces through one compliance that changes along the screw (eqs. 5.3.1, 5.3.9).

        stretch = (1 + slope away + bow away^2 + nut softness) loads @ value + beside @ rest,

    by Gauss-Newton on the slope, and on the bow with its prior; the softness is that of the nut
    where its preload differs from the mean. The maps are as uneven as those of their steps say that
    the axis has made.

    Returns:
        slope, 1/m, bow, 1/m^2, and the fit on [loads, change of the slope, bow, beside].
    """
    slope, bow, value, loads, share = 0.0, 0.0, np.zeros(3), seen.loads, np.eye(3)[0]
    away_m, table_m = seen.away_m, seen.phases.table_m
    free = np.inf if seen.sloped else _NONE
    sigma = np.concatenate([[np.inf, np.inf, free, free, free], beside.sigma])
    for _ in range(8):
        through = loads * (1.0 + slope * away_m + nut_softness(table_m, float(value[0])))[:, None]
        whole = loads @ share
        columns = np.column_stack([through, whole * away_m, whole * away_m**2, beside.columns])
        fit = robust_regression(columns, seen.stretch_m, seen.phases, sigma)
        value, share = fit.value[:3], fit.value[:3] / fit.value[0]
        slope, bow = slope + float(fit.value[3] / value[0]), float(fit.value[4] / value[0])
        sigma[4] = 4.0 * BOW_SIGMA * abs(value[0]) / seen.stroke_m**2 if seen.sloped else _NONE
        for each in beside.maps:
            sigma[each][1:] = _step_sigma(fit, each, beside.visited)
    return slope, bow, fit


def _step_sigma(fit: RegressionFit, steps: slice, visited: Floats) -> float:
    """Standard deviation of a map's steps between nodes where the axis has been (one EM step)."""
    made = np.minimum(visited[1:], visited[:-1]) > 0.0
    square = fit.value[steps][1:] ** 2 + np.diag(fit.covariance)[steps][1:]
    return float(np.sqrt(np.mean(square[made]))) if made.any() else _NONE


def _drift_columns(run: Floats, time_s: Floats, away_m: Floats) -> Floats:
    """Offset and growth of the screw, each a broken line in time with a node a minute."""
    parts = []
    for number in np.unique(run):
        mine = run == number
        begin, end = float(time_s[mine].min()), float(time_s[mine].max())
        nodes = np.linspace(begin, end, max(round((end - begin) / 60.0), 1) + 1)
        hats = _hats(np.where(mine, time_s, begin), nodes) * mine[:, None]
        parts += [hats, hats * away_m[:, None]]
    return np.column_stack(parts)


def _hats(place: Floats, nodes: Floats) -> Floats:
    """Weights of linear interpolation between nodes, (n, k)."""
    return np.column_stack([np.interp(place, nodes, row) for row in np.eye(len(nodes))])
