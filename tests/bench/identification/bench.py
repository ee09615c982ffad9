"""Coverage of the truth by identification's own intervals, over many simulated axes."""

import contextlib
import math
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import stats

from edge_service.fingerprint.regression.interval_estimate import LEVEL

from ..figures import Progress
from .cases import Recovered, Recoveries, recoveries

_THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_HEADINGS = ("parameter", "unit", "truth", "mean", "bias/s", "held", "share, 95 %", "width")


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


@dataclass(frozen=True, slots=True)
class IdentificationBench:
    """All parameters."""

    recoveries: tuple[Recovery, ...]

    @classmethod
    def of(cls, runs: Sequence[Recoveries]) -> "IdentificationBench":
        """One entry for each parameter of the first run."""
        return cls(tuple(Recovery.of(name, [run[name] for run in runs]) for name in runs[0]))

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values; null is a number that does not exist."""
        return {
            "schema": "identification_bench/1",
            "level": LEVEL,
            "parameters": [
                {key: _finite(value) for key, value in asdict(each).items()}
                for each in self.recoveries
            ],
        }

    def as_text(self) -> str:
        """An aligned table, then what it means."""
        rows = [_HEADINGS, *(_row(each) for each in self.recoveries)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADINGS))]
        lines = [
            "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        held, count = sum(r.held for r in self.recoveries), sum(r.count for r in self.recoveries)
        return "\n".join(
            [
                *lines,
                "",
                f"{held} of {count} intervals hold the truth, {100 * LEVEL:g} % are meant to; "
                "bias/s: mean error over the stated standard deviation; width: of the interval, "
                "as a share of the truth where that is not 0.",
            ]
        )


def run(seeds: int, progress: Progress = lambda _line: None) -> IdentificationBench:
    """Identify `seeds` simulated axes on all cores."""
    workers = min(os.cpu_count() or 1, seeds)
    runs = []
    context = multiprocessing.get_context("spawn")
    with _one_thread_each(), ProcessPoolExecutor(workers, mp_context=context) as pool:
        for done in pool.map(recoveries, range(1, seeds + 1)):
            runs.append(done)
            progress(f"{len(runs)} of {seeds} axes")
    return IdentificationBench.of(runs)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes begun meanwhile leave the other cores to each other."""
    before = {name: os.environ.get(name) for name in _THREAD_COUNTS}
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _row(each: Recovery) -> tuple[str, ...]:
    width = f"{each.width:.2g}"
    if each.truth:
        width = f"{100.0 * each.width / abs(each.truth):.2g} %"
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
