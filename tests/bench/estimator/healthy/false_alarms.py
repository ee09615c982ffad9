"""Rate of false alarms of the fused estimator on the thesis' plant whose preload never changes."""

from dataclasses import dataclass

import numpy as np

from edge_service.estimate.mixture.estimator import FusedPreloadEstimator
from edge_service.estimate.mixture.state import PRELOAD, Bank
from edge_service.messages.samples import Floats
from edge_service.offline.thesis.runs import SETTLED_STEPS, ThesisCase, run_case

from ...table import Figure
from ..plants.thesis import FRESH_PERCENT, SETTINGS, thesis_blocks, thesis_machine
from ..speed.batch import MixtureBatch
from ..speed.fused_speed import phases_of

AIM_PER_MILLION = 1.0
STEP_LEVEL_PERCENT = FRESH_PERCENT - 0.5
DROP_LEVEL_PERCENT = 0.5 * FRESH_PERCENT
"""An estimate below these sees a one-point step, and a full drop; as in the bench's rows."""


@dataclass(frozen=True, slots=True)
class FalseAlarms:
    """Times that an estimate fell below a level, in so many steps with information."""

    steps: int
    of_a_step: int
    of_a_drop: int

    def figures(self) -> list[Figure]:
        """Per million steps."""
        million, aim = self.steps / 1e6, AIM_PER_MILLION
        name = f"false alarms in {self.steps:,} steps, thesis' plant"
        return [
            Figure("false_drops", f"{name}: full drop", self.of_a_drop / million, "per 1e6", aim),
            Figure("false_steps", f"{name}: one point", self.of_a_step / million, "per 1e6", aim),
        ]


def count_false_alarms(runs: int, first_seed: int = 1000) -> FalseAlarms:
    """Constant 10 %, open loop, T = 0.1 s, 1000 steps each."""
    machine = thesis_machine()
    axes = []
    for seed in range(first_seed, first_seed + runs):
        run, _ = run_case(ThesisCase(FRESH_PERCENT), seed)
        axes.append(phases_of(machine, thesis_blocks(run)))
    estimators = [FusedPreloadEstimator(machine, SETTINGS) for _ in axes]
    banks = [estimator._bank for estimator in estimators]
    batch = MixtureBatch((e._bank, e._model, e._process) for e in estimators)
    count = min(len(phases.readings) for phases in axes)
    numbers, percent = np.arange(runs), np.empty((count, runs))
    for k in range(count):
        batch.step(
            numbers,
            np.array([phases.readings[k] for phases in axes]),
            np.array([phases.elapsed_s[k] for phases in axes]),
        )
        percent[k] = [_preload_percent(bank) for bank in banks]
    settled = percent[SETTLED_STEPS:]
    return FalseAlarms(
        settled.size,
        _times_below(settled, STEP_LEVEL_PERCENT),
        _times_below(settled, DROP_LEVEL_PERCENT),
    )


def _preload_percent(bank: Bank) -> float:
    alive = bank.alive > 0
    weight = np.exp(bank.log_weight[alive])
    return float(weight @ np.exp(bank.mean[alive, PRELOAD]) / weight.sum())


def _times_below(percent: Floats, level: float) -> int:
    """Entries below a level over all runs, (steps, runs)."""
    below = percent < level
    return int(below[0].sum() + (below[1:] & ~below[:-1]).sum())
