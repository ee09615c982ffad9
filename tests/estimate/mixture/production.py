"""Production runs of the library's own axis as blocks, and what the estimator says to them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine

from ...bench.estimator.axis import RATE_HZ, OwnAxis, downsampled
from ...bench.estimator.lying import spoiled
from ...bench.estimator.scores import MISLEADING_PERCENT
from ...cases.case_file import Edit

AXIS = OwnAxis(1)
FRESH = AXIS.fresh_percent


@cache
def machine(one_encoder: bool = False) -> Machine:
    return OwnAxis(1, one_encoder=one_encoder).commissioned()


@cache
def production(name: str, seconds: float = 60.0, one_encoder: bool = False) -> list[FeatureBlock]:
    """Blocks of a production run in which something happens at half time."""
    count = round(seconds * 1e3)
    after, percent = np.arange(count) >= count // 2, np.full(count, FRESH)
    percent -= after * {"step": 1.0, "drop": FRESH}.get(name, 0.0)
    loads = {"added_mass_kg": 10.0 * after} if name == "payload" else {}
    axis = replace(AXIS, one_encoder=one_encoder)
    return downsampled(axis.frames("production", percent, 6, **loads), axis.nominal())


def run(
    blocks: Sequence[FeatureBlock], estimator: MixturePreloadEstimator | None = None
) -> list[PreloadEstimate]:
    estimator, estimates = estimator or MixturePreloadEstimator(machine()), []
    for block in blocks:
        estimator.update(block)
        estimates.append(estimator.estimate())
    return estimates


def answers_to(
    edit: Edit, duration_s: float = 60.0, effects: Sequence[str] = (), one_encoder: bool = False
) -> list[PreloadEstimate]:
    """Estimates of a well commissioned axis, (intervals,), whose recorder has a fault."""
    percent = np.full(round(duration_s * RATE_HZ), FRESH)
    axis, known = replace(AXIS, one_encoder=one_encoder), machine(one_encoder)
    frames = spoiled(axis.frames("production", percent, 81, effects), edit)
    return run(downsampled([frames], known), MixturePreloadEstimator(known))


def numbers(estimates: Sequence[PreloadEstimate]) -> Floats:
    """Time, preload, low, high of those that have a number, (n, 4)."""
    rows = [(e.time_s, e.preload_percent, e.low, e.high) for e in estimates]
    answers = [row for row in rows if row[1] is not None]
    return np.array(answers, dtype=np.float64).reshape(-1, 4)


def held(answers: Floats, percent: float) -> float:
    """Share of numbers whose interval holds a preload."""
    return float(np.mean((answers[:, 2] <= percent) & (answers[:, 3] >= percent)))


def misled(answers: Floats, percent: float) -> float:
    """Share of numbers whose interval misses a preload by more than `MISLEADING_PERCENT`."""
    away = np.maximum(answers[:, 2] - percent, percent - answers[:, 3])
    return float(np.mean(away > MISLEADING_PERCENT)) if len(answers) else 0.0
