"""Coverage of the truth by identification's own intervals, over many simulated axes."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import stats

from edge_service.regression.interval_estimate import LEVEL

from ..table import Progress, Table, in_processes
from .cases import Recovered, Recoveries, recoveries

_HEADS = ("parameter", "unit", "truth", "mean", "bias/s", "held", "share, 95 %", "width")


@dataclass(frozen=True, slots=True)
class Recovery:
    """One parameter over all seeds.

    Attributes:
        truth, mean: the truth and the mean estimate of the determined ones.
        bias_sigma: mean error over the mean standard deviation that the intervals state.
        held: in how many the interval holds the truth; infinite intervals do.
        count: of seeds; `undetermined` of them have no finite interval.
        share_low, share_high: of held to count, 95 % (Clopper and Pearson, 1934).
        width: mean width of the finite intervals, in the unit.
    """

    name: str
    unit: str
    truth: float
    mean: float
    bias_sigma: float
    held: int
    count: int
    undetermined: int
    share_low: float
    share_high: float
    width: float

    @classmethod
    def of(cls, name: str, each: Sequence[Recovered]) -> "Recovery":
        """Summed up; a truth that changes with the seed counts by its mean."""
        known = [one for one in each if one.found.determined and math.isfinite(one.found.value)]
        held, count = sum(one.found.holds(one.truth) for one in each), len(each)
        error = [one.found.value - one.truth for one in known]
        sigma = [one.found.sigma for one in known]
        low, high = share_interval(held, count)
        nothing = math.nan
        return cls(
            name,
            each[0].found.unit,
            float(np.mean([one.truth for one in each])),
            float(np.mean([one.found.value for one in known])) if known else nothing,
            float(np.mean(error) / np.mean(sigma)) if known else nothing,
            held,
            count,
            count - len(known),
            low,
            high,
            float(np.mean([one.found.high - one.found.low for one in known])) if known else nothing,
        )


def share_interval(held: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Interval of a binomial share (Clopper and Pearson, 1934).

    >>> [round(bound, 3) for bound in share_interval(95, 100)]
    [0.887, 0.984]
    """
    tail = 0.5 * (1.0 - level)
    low = float(stats.beta.ppf(tail, held, count - held + 1)) if held else 0.0
    high = float(stats.beta.ppf(1.0 - tail, held + 1, count - held)) if held < count else 1.0
    return low, high


def run(seeds: int, progress: Progress = lambda _line: None) -> list[Recovery]:
    """Identify `seeds` simulated axes on all cores; one entry for each parameter."""
    runs: dict[int, Recoveries] = {}
    jobs = [partial(recoveries, seed) for seed in range(1, seeds + 1)]
    for number, done in in_processes(jobs, min(os.cpu_count() or 1, seeds)):
        runs[number] = done
        progress(f"{len(runs)} of {seeds} axes")
    return [Recovery.of(name, [runs[k][name] for k in range(seeds)]) for name in runs[0]]


def table_of(found: Sequence[Recovery]) -> Table:
    """A row for each parameter, then what it means."""
    held, count = sum(each.held for each in found), sum(each.count for each in found)
    note = (
        f"{held} of {count} intervals hold the truth, {100 * LEVEL:g} % are meant to; "
        "bias/s: mean error over the stated standard deviation; width: of the interval, "
        "as a share of the truth where that is not 0."
    )
    return Table(_HEADS, tuple(_row(each) for each in found), (note,))


def _row(each: Recovery) -> tuple[str, ...]:
    width = f"{100.0 * each.width / abs(each.truth):.2g} %" if each.truth else f"{each.width:.2g}"
    missing = f" ({each.undetermined} infinite)" if each.undetermined else ""
    return (
        each.name,
        each.unit,
        f"{each.truth:.5g}",
        f"{each.mean:.5g}",
        f"{each.bias_sigma:+.2f}",
        f"{each.held}/{each.count}{missing}",
        f"{each.share_low:.2f} to {each.share_high:.2f}",
        width,
    )
