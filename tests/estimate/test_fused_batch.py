"""Axes in a batch are the same axes one by one."""

from collections.abc import Callable

import numpy as np
import pytest

from edge_service.estimate.fused import FusedPreloadEstimator
from edge_service.estimate.fused_batch import READING_SIZE, FusedBatch
from edge_service.estimate.fused_kernel import take
from edge_service.estimate.fused_state import Reading
from edge_service.studies.estimator_seed import SETTINGS, thesis_blocks, thesis_machine
from edge_service.studies.fused_speed import Phases, phases_of
from edge_service.studies.thesis_runs import ThesisCase, run_case

AXES = 3


def estimators() -> list[FusedPreloadEstimator]:
    return [FusedPreloadEstimator(thesis_machine(), SETTINGS) for _ in range(AXES)]


def batch_of(axes: list[FusedPreloadEstimator]) -> FusedBatch:
    return FusedBatch((e._mixture, e._model, e._drift) for e in axes)


def phases(seed: int) -> Phases:
    run, _ = run_case(ThesisCase(4), seed)
    return phases_of(thesis_machine(), thesis_blocks(run))


def test_a_batch_gives_the_bits_of_its_axes_one_by_one() -> None:
    """A full drop at half time on each axis, with noise of its own; axes in random order."""
    told = [phases(seed) for seed in range(AXES)]
    order = np.random.default_rng(5).permutation(
        np.repeat(np.arange(AXES), [len(each.readings) for each in told])
    )
    turn = np.array([np.count_nonzero(order[:k] == axis) for k, axis in enumerate(order)])
    columns = [
        np.array([getattr(told[axis], name)[k] for axis, k in zip(order, turn, strict=True)])
        for name in ("readings", "elapsed_s", "spawn")
    ]
    together, alone = estimators(), estimators()
    nis = batch_of(together).take(order, *columns)
    for row, axis in enumerate(order):
        e = alone[axis]
        reading = Reading(*(float(value) for value in columns[0][row]))
        expected = take(e._mixture, e._model, e._drift, reading, columns[1][row], columns[2][row])
        assert nis[row] == expected or np.isnan([nis[row], expected]).all()
    for mine, other in zip(together, alone, strict=True):
        for first, second in zip(mine._mixture, other._mixture, strict=True):
            np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda axes, rows, s, b: (axes, rows[:, 1:], s, b),
        lambda axes, rows, s, b: (axes, rows, s[1:], b),
        lambda axes, rows, s, b: (axes + 1, rows, s, b),
        lambda axes, rows, s, b: (axes - 1, rows, s, b),
    ],
)
def test_what_does_not_belong_together_is_refused(
    spoil: Callable[..., tuple[np.ndarray, ...]],
) -> None:
    batch = batch_of(estimators())
    good = (np.arange(AXES), np.ones((AXES, READING_SIZE)), np.ones(AXES), np.zeros(AXES, bool))
    with pytest.raises(ValueError, match=r"shapes|axes are"):
        batch.take(*spoil(*good))


def test_a_batch_without_axes_is_refused() -> None:
    with pytest.raises(ValueError, match="needs an axis"):
        FusedBatch([])
