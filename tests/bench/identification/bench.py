"""Coverage of the truth by identification's own intervals, over many simulated axes."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from scipy import stats

from edge_service.regression.interval_estimate import LEVEL

from ..table import Progress, Table, in_processes, mean_of
from .cases import Recovered, Recoveries, recoveries


@dataclass(frozen=True, slots=True)
class Recovery:
    """One parameter over all seeds; its means are of those with a finite interval."""

    name: str
    unit: str
    truth: float  # by its mean where it changes with the seed
    mean: float
    bias_sigma: float  # mean error over the mean standard deviation that the intervals state
    held: int  # in how many the interval holds the truth; infinite intervals do
    count: int  # of seeds; `undetermined` of them have no finite interval
    undetermined: int
    width: float  # mean width of the finite intervals, in the unit

    @classmethod
    def of(cls, name: str, each: Sequence[Recovered]) -> "Recovery":
        known = [one for one in each if one.found.determined and math.isfinite(one.found.value)]
        error = mean_of([one.found.value - one.truth for one in known])
        return cls(
            name,
            each[0].found.unit,
            mean_of([one.truth for one in each]),
            mean_of([one.found.value for one in known]),
            error / mean_of([one.found.sigma for one in known]),
            sum(one.found.holds(one.truth) for one in each),
            len(each),
            len(each) - len(known),
            mean_of([one.found.high - one.found.low for one in known]),
        )

    def row(self) -> Mapping[str, str]:
        """As printed; the share of those that hold it by Clopper and Pearson, 1934."""
        share = stats.binomtest(self.held, self.count).proportion_ci(0.95)
        missing = f" ({self.undetermined} infinite)" if self.undetermined else ""
        relative = f"{100.0 * self.width / abs(self.truth):.2g} %" if self.truth else ""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "truth": f"{self.truth:.5g}",
            "mean": f"{self.mean:.5g}",
            "bias/s": f"{self.bias_sigma:+.2f}",
            "held": f"{self.held}/{self.count}{missing}",
            "share, 95 %": f"{share.low:.2f} to {share.high:.2f}",
            "width": relative or f"{self.width:.2g}",
        }


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
    return Table.of(
        [each.row() for each in found],
        f"{held} of {count} intervals hold the truth, {100 * LEVEL:g} % are meant to; "
        "bias/s: mean error over the stated standard deviation; width: of the interval, "
        "as a share of the truth where that is not 0.",
    )
