"""Processor time of one interval through each estimator, and through filterpy's five modes."""

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from edge_service.estimate.interface import PreloadEstimator
from edge_service.nodes.stages import make_beside, make_estimator
from edge_service.recordings.reader import read_trace

from ..estimator.axis import downsampled
from .peer import bank


def estimator_us(recording: Path, repeats: int) -> list[float]:
    """An interval through the mixture, the second opinion by both engines, and the peer, us."""
    machine = load_machine(DEFAULT_MACHINE.with_name("commissioned.toml"))
    blocks = downsampled([read_trace(recording)], machine)
    compiled, filterpy, peer = EstimatorConfig(), EstimatorConfig(engine="filterpy"), bank()

    def run(estimator: PreloadEstimator) -> None:
        for block in blocks:
            estimator.update(block)
            estimator.estimate()

    def theirs() -> None:
        for block in blocks:
            peer.predict()
            peer.update(np.array([block.torque_mean_nm, block.speed_end_rad_s]))

    work = (
        lambda: run(make_estimator(compiled, machine)),
        lambda: run(make_beside(compiled, machine)),
        lambda: run(make_beside(filterpy, machine)),
        theirs,
    )
    return [1e6 / len(blocks) * _median_s(each, repeats) for each in work]


def _median_s(work: Callable[[], None], repeats: int) -> float:
    """Median processor time, after a first run, s."""
    work()
    spent = []
    for _ in range(repeats):
        begun_s = time.process_time()
        work()
        spent.append(time.process_time() - begun_s)
    return statistics.median(spent)
