"""Regression of one channel on another: factor, lag and what the mechanics put between."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.samples import Floats, SampleFrame
from ..recordings.conditioning import (
    CUTOFF_SHARE,
    UniformRun,
    central_difference,
    low_pass,
    uniform_runs,
    white_noise_rms,
)
from ..regression.interval_estimate import IntervalEstimate, undetermined
from ..regression.linear import least_squares

CUTOFF_HZ = 50.0
ORDER = 4
EDGE_PERIODS = 2.0
"""Periods of the cutoff that are cut from both ends of a run."""
MOST_ROWS = 200_000
LEAST_MOTION = 100.0
"""Times its white noise; less biases the factor by more than 1 in 10,000."""
STANDSTILL_SHARE = 0.02
"""Of the greatest speed: slower than that, the direction is unknown."""


@dataclass(frozen=True, slots=True)
class ChannelRegression:
    """target = factor * source(t - lag) + the mechanics."""

    factor: IntervalEstimate  # of the target's unit over the source's
    lag: IntervalEstimate  # by how much the target comes later, s


def regress_channel(
    recordings: Iterable[SampleFrame],
    target: str,
    source: str,
    *,
    derivative: int = 0,
    mechanics: bool = False,
) -> ChannelRegression:
    """Regress a channel on another one, or on its derivative, and on the next derivative.

    To first order, s(t - lag) = s(t) - lag ds/dt. Both pass the same zero-phase low-pass.

    Args:
        derivative: how often the source is differentiated first: 1 where the target is its speed.
        mechanics: the target is on the other side of a spring: what it stays behind by direction
            (friction, play) and by acceleration (stretch) is told apart from a lag.

    Raises ValueError: a channel is missing, or too little moves.
    """
    runs = [
        run
        for frame in recordings
        if {target, source} <= frame.channels.keys()
        for run in uniform_runs(frame, (target, source))
    ]
    if not runs:
        raise ValueError(f"no recording has {target} and {source}")
    moving = [run for run in runs if _moves(run.channels[source])]
    if not moving:
        raise ValueError(f"{source} does not move")
    pieces = (_rows(run, target, source, derivative, mechanics) for run in moving)
    design, wanted = map(np.concatenate, zip(*pieces, strict=True))
    step = len(wanted) // MOST_ROWS + 1
    names = ("factor", "lag", "direction", "stretch")[: design.shape[1]]
    fit = least_squares(names, design[::step], wanted[::step])
    factor, slope = fit.interval_estimate("factor", ""), fit.interval_estimate("lag", "s")
    if not factor.determined or factor.holds(0.0):
        return ChannelRegression(factor, undetermined("s", "the factor itself is not determined"))
    return ChannelRegression(factor, slope.scaled(-1.0 / factor.value, "s"))


def _moves(values: Floats) -> bool:
    """Motion beyond the noise: noise in a regressor would pull the factor to 0."""
    motion = float(np.std(values)) if np.ptp(values) > 0.0 else 0.0
    return motion > LEAST_MOTION * white_noise_rms(values)


def _rows(
    run: UniformRun, target: str, source: str, derivative: int, mechanics: bool
) -> tuple[Floats, Floats]:
    """Regressors (n, p) and target (n,) of one run, each without its mean over the run."""
    cutoff_hz = min(CUTOFF_HZ, CUTOFF_SHARE / run.period_s)
    wanted, moved = (
        low_pass(run.channels[name], cutoff_hz, ORDER, run.period_s) for name in (target, source)
    )
    series = [moved]
    for _ in range(max(derivative + 1, 2 if mechanics else 1)):
        series.append(central_difference(series[-1], run.period_s))
    columns: Sequence[Floats] = series[derivative : derivative + 2]
    if mechanics:
        speed = series[1]
        direction = np.sign(speed) * (np.abs(speed) > STANDSTILL_SHARE * np.abs(speed).max())
        columns = [*columns, direction, series[2]]
    edge = round(EDGE_PERIODS / cutoff_hz / run.period_s)
    inside = slice(edge, len(run) - edge)
    design = np.column_stack([column[inside] for column in columns])
    if len(design) == 0:
        return design, wanted[inside]
    design -= design.mean(axis=0)
    return design, wanted[inside] - wanted[inside].mean()
