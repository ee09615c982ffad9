"""Processor time that the estimators take: the bank, filterpy, and the fused estimator."""

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.estimate.mixture.estimator import FusedPreloadEstimator, plausible
from edge_service.estimate.mixture.gathering import SteadyInterval
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine

from ...table import Figure, PipelineBench
from ..axis import OwnAxis, downsampled
from .batch import MixtureBatch
from .speed import measure_estimator_speed

BANK_AIM_PER_S, FUSED_AIM_PER_S = 1e6, 200e3
FLEET_AXES, FLEET_RATE_HZ, FLEET_AIM_CORES = 1000, 10.0, 0.15
INTERVAL_S = 0.1


@dataclass(frozen=True, slots=True)
class Phases:
    """Phases of one axis as the kernel takes them, one after the other.

    Attributes:
        readings: (n, READING_SIZE).
        elapsed_s: (n,).
        blocks: of INTERVAL_S from which they came.
    """

    readings: Floats
    elapsed_s: Floats
    blocks: int


@dataclass(frozen=True, slots=True)
class FusedSpeed:
    """Processor time of one core, s, and how many hypotheses lived on average.

    `settled`: in the last third of the run.
    """

    kernel_s_per_phase: float
    settled_s_per_phase: float
    update_s_per_block: float
    answer_s_per_block: float
    fleet_s_per_block: float
    hypotheses: float
    settled_hypotheses: float


def speed_bench(quick: bool = False, repeats: int = 7) -> PipelineBench:
    """All figures of this machine, beside the aims."""
    bank = measure_estimator_speed(3 if quick else repeats)
    axis = OwnAxis(1)
    fused = measure_fused_speed(
        axis.commissioned(),
        production_blocks(axis, 20.0 if quick else 60.0),
        axes=100 if quick else FLEET_AXES,
        repeats=1 if quick else 3,
    )
    fleet_hz = FLEET_AXES * FLEET_RATE_HZ
    unit, cores = "steps/s", "cores"
    figures = (
        Figure(
            "bank_per_s",
            "five-mode bank, whole run",
            bank.batch_steps_per_s,
            unit,
            at_least=BANK_AIM_PER_S,
        ),
        Figure("bank_single_per_s", "five-mode bank, by steps", bank.single_steps_per_s, unit),
        Figure("filterpy_per_s", "filterpy, by steps", bank.filterpy_steps_per_s, unit),
        Figure("bank_over_filterpy", "whole run over filterpy", bank.batch_over_filterpy, "times"),
        Figure(
            "fused_kernel_per_s",
            "fused estimator, compiled over phases",
            1.0 / fused.kernel_s_per_phase,
            unit,
            at_least=FUSED_AIM_PER_S,
        ),
        Figure("fused_hypotheses", "hypotheses alive on average", fused.hypotheses, ""),
        Figure(
            "fused_settled_per_s",
            "the same, last third of the run",
            1.0 / fused.settled_s_per_phase,
            unit,
            at_least=FUSED_AIM_PER_S,
        ),
        Figure("fused_settled_hypotheses", "hypotheses then", fused.settled_hypotheses, ""),
        Figure("fused_update_per_s", "`update` per interval", 1.0 / fused.update_s_per_block, unit),
        Figure(
            "fused_answer_per_s",
            "`update` and `estimate` per interval",
            1.0 / (fused.update_s_per_block + fused.answer_s_per_block),
            unit,
        ),
        Figure(
            "fleet_kernel_cores",
            "1,000 axes at 10 Hz, compiled batch",
            fused.fleet_s_per_block * fleet_hz,
            cores,
            at_most=FLEET_AIM_CORES,
        ),
        Figure(
            "fleet_update_cores",
            "1,000 axes at 10 Hz, `update` each",
            fused.update_s_per_block * fleet_hz,
            cores,
            at_most=FLEET_AIM_CORES,
        ),
        Figure(
            "fleet_answer_cores",
            "1,000 axes at 10 Hz, `update` and `estimate` each",
            (fused.update_s_per_block + fused.answer_s_per_block) * fleet_hz,
            cores,
            at_most=FLEET_AIM_CORES,
        ),
    )
    note = (
        f"Python {platform.python_version()}, {os.cpu_count()} cores; processor time of one thread."
        " A step of the kernel is one phase of an axis, else one interval of 0.1 s."
    )
    return PipelineBench(figures, (note,))


def production_blocks(axis: OwnAxis, duration_s: float) -> list[FeatureBlock]:
    """Ordinary production of a healthy axis."""
    percent = np.full(round(duration_s * 1e3), axis.fresh_percent)
    return downsampled(axis.frames("production", percent, 6), axis.nominal())


def measure_fused_speed(
    machine: Machine, blocks: Sequence[FeatureBlock], axes: int, repeats: int = 3
) -> FusedSpeed:
    """Least of some repeats: one axis compiled, one through its interface, many in a batch.

    Args:
        axes: of the batch; they take the same blocks, each with a filter of its own.
    """
    phases = phases_of(machine, blocks)
    estimator = FusedPreloadEstimator(machine)
    alive: list[int] = []

    def update() -> None:
        estimator.reset()
        for block in blocks:
            estimator.update(block)
            alive.append(int(estimator._bank.alive.sum()))

    def answer() -> None:
        for _ in range(100):
            estimator.estimate()

    update_s = _least_cpu_s(update, repeats) / len(blocks)
    answer_s = _least_cpu_s(answer, repeats) / 100
    count = len(phases.readings)
    settled = 2 * count // 3
    return FusedSpeed(
        kernel_s_per_phase=_batch_s(machine, phases, 1, repeats) / count,
        settled_s_per_phase=_batch_s(machine, phases, 1, repeats, settled) / (count - settled),
        update_s_per_block=update_s,
        answer_s_per_block=answer_s,
        fleet_s_per_block=_batch_s(machine, phases, axes, 1) / (axes * phases.blocks),
        hypotheses=float(np.mean(alive)),
        settled_hypotheses=float(np.mean(alive[-len(blocks) // 3 :])),
    )


def phases_of(machine: Machine, blocks: Sequence[FeatureBlock]) -> Phases:
    """Phases that an estimator would hand to its kernel, but for those that it leaves out."""
    estimator = FusedPreloadEstimator(machine)
    rows: list[tuple[float, ...]] = []
    last_s = blocks[0].time_s - blocks[0].duration_s
    for block in (block for block in blocks if block.usable):
        for phase in block.phases:
            reading = estimator._reading(SteadyInterval.of(block), phase)
            if not plausible(reading):
                continue
            rows.append((*reading, block.time_s - last_s))
            last_s = block.time_s
    table = np.array(rows)
    return Phases(np.ascontiguousarray(table[:, :-1]), table[:, -1].copy(), len(blocks))


def _batch_s(machine: Machine, phases: Phases, axes: int, repeats: int, first: int = 0) -> float:
    """Processor time of so many axes that begin, over all phases from `first` on."""

    def spent_s() -> float:
        estimators = [FusedPreloadEstimator(machine) for _ in range(axes)]
        batch = MixtureBatch((e._bank, e._model, e._process) for e in estimators)
        _feed(batch, phases, slice(0, first), axes)  # compiles, if nothing else
        begun_s = time.process_time()
        _feed(batch, phases, slice(first, None), axes)
        return time.process_time() - begun_s

    return min(spent_s() for _ in range(repeats))


def _feed(batch: MixtureBatch, phases: Phases, rows: slice, axes: int) -> None:
    """Give some phases to every axis, interleaved as they would arrive."""
    readings = phases.readings[rows]
    batch.step(
        np.tile(np.arange(axes), len(readings)),
        np.repeat(readings, axes, axis=0),
        np.repeat(phases.elapsed_s[rows], axes),
    )


def _least_cpu_s(work: Callable[[], object], repeats: int) -> float:
    """Least processor time, after a run that compiles; other work on the machine only adds."""
    work()
    spent_s = []
    for _ in range(repeats):
        begun_s = time.process_time()
        work()
        spent_s.append(time.process_time() - begun_s)
    return min(spent_s)
