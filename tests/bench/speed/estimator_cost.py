"""Processor time of one interval through the estimator, and through filterpy's five modes."""

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from edge_service.nodes.stages import make_estimator
from edge_service.recordings.reader import read_trace

from ..estimator.axis import downsampled
from .peer import bank


def estimator_us(recording: Path, repeats: int) -> tuple[float, float]:
    """An interval through the mixture estimator, and through filterpy's five modes, us."""
    machine = load_machine(DEFAULT_MACHINE)
    blocks = downsampled([read_trace(recording)], machine)
    peer = bank()

    def ours() -> None:
        estimator = make_estimator(EstimatorConfig(), machine)
        for block in blocks:
            estimator.update(block)
            estimator.estimate()

    def theirs() -> None:
        for block in blocks:
            peer.predict()
            peer.update(np.array([block.torque_mean_nm, block.speed_end_rad_s]))

    us = 1e6 / len(blocks)
    return us * _median_s(ours, repeats), us * _median_s(theirs, repeats)


def _median_s(work: Callable[[], None], repeats: int) -> float:
    """Median processor time, after a first run, s."""
    work()
    spent = []
    for _ in range(repeats):
        begun_s = time.process_time()
        work()
        spent.append(time.process_time() - begun_s)
    return statistics.median(spent)
