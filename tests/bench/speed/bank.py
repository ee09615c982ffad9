"""Five-mode steps per second of the filter banks on this machine."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

from edge_service.estimate.imm.bank import (
    BankStart,
    CompiledBank,
    FilterBank,
    LinearStep,
    run_bank,
)
from edge_service.estimate.imm.filterpy_bank import FilterpyBank
from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.simulation import ThesisCase, bank_inputs, run_case

REPEATS = 7
SINGLE_STEPS = 500
FILTERPY_STEPS = 100


@dataclass(frozen=True, slots=True)
class EstimatorSpeed:
    """Five modes, two states, two measurements, one thread; medians of several repeats.

    Attributes:
        batch_steps_per_s: the compiled kernel over a whole run.
        single_steps_per_s: the same kernel through `step`, one measurement at a time.
        filterpy_steps_per_s: filterpy through `step`, on the same data.
    """

    batch_steps_per_s: float
    single_steps_per_s: float
    filterpy_steps_per_s: float
    repeats: int

    @property
    def batch_over_filterpy(self) -> float:
        """Speed of the batch as a multiple of filterpy's."""
        return self.batch_steps_per_s / self.filterpy_steps_per_s

    @property
    def single_over_filterpy(self) -> float:
        """Speed of single steps as a multiple of filterpy's."""
        return self.single_steps_per_s / self.filterpy_steps_per_s


def measure_estimator_speed(repeats: int = REPEATS) -> EstimatorSpeed:
    """Time the three ways on one run of simulation 1 (100 s in steps of 1 ms for the batch)."""
    run, _ = run_case(ThesisCase(1, step_s=1e-3), seed=0)
    step, drives, start = bank_inputs(ThesisCase(1, step_s=1e-3), run)
    measurements = run.measurement

    def batch() -> None:
        run_bank(step, drives, measurements, start)

    def one_by_one(bank: FilterBank, steps: int) -> Callable[[], None]:
        inputs = _single_inputs(step, drives, measurements, steps)
        return lambda: _feed(bank, start, inputs)

    single = one_by_one(CompiledBank(), SINGLE_STEPS)
    filterpy = one_by_one(FilterpyBank(), FILTERPY_STEPS)
    return EstimatorSpeed(
        batch_steps_per_s=len(drives) / _median_duration_s(batch, repeats),
        single_steps_per_s=SINGLE_STEPS / _median_duration_s(single, repeats),
        filterpy_steps_per_s=FILTERPY_STEPS / _median_duration_s(filterpy, repeats),
        repeats=repeats,
    )


def _single_inputs(
    step: LinearStep, drives: Floats, measurements: Floats, count: int
) -> list[tuple[LinearStep, Floats]]:
    return [(replace(step, drive=drives[k]), measurements[k]) for k in range(count)]


def _feed(bank: FilterBank, start: BankStart, inputs: list[tuple[LinearStep, Floats]]) -> None:
    bank.reset(start)
    for step, measurement in inputs:
        bank.step(step, measurement)


def _median_duration_s(work: Callable[[], None], repeats: int) -> float:
    """Median processor time over the repeats, after one that compiles and warms up, s."""
    work()
    durations = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        durations.append(time.process_time() - start)
    return median(durations)
