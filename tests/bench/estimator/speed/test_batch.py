"""Axes in a batch are the same axes one by one."""

from collections.abc import Callable

import numpy as np
import pytest

from edge_service.estimate.mixture.initial import initial_bank
from edge_service.estimate.mixture.state import AxisModel, Bank, Process
from edge_service.estimate.mixture.step import step

from ....estimate.mixture.mixture_axis import FRESH, SETTINGS, Truth, parts, production
from .batch import READING_SIZE, MixtureBatch

AXES = 3


def axes() -> list[tuple[Bank, AxisModel, Process]]:
    """Each begins its challengers at a pace of its own."""
    rows = []
    for number in range(AXES):
        model, start, process = parts(one_encoder=False)
        rows.append((initial_bank(start, SETTINGS), model, process._replace(spawn_s=1.0 + number)))
    return rows


def test_a_batch_gives_the_bits_of_its_axes_one_by_one() -> None:
    """Each loses its preload at another time, with noise of its own; in random order."""
    phases = [
        [*production(seed, 25.0 + seed, Truth()), *production(9, 10.0, Truth(percent=1.0))]
        for seed in range(AXES)
    ]
    order = np.random.default_rng(5).permutation(
        np.repeat(np.arange(AXES), [len(each) for each in phases])
    )
    turn = np.array([np.count_nonzero(order[:k] == axis) for k, axis in enumerate(order)])
    readings = [phases[axis][k] for axis, k in zip(order, turn, strict=True)]
    elapsed_s = np.random.default_rng(6).choice([0.1, 0.2, 3.0], len(order), p=[0.9, 0.09, 0.01])
    together, alone = axes(), axes()
    table = np.array([[float(value) for value in r] for r in readings])
    nis = MixtureBatch(together).step(order, table, elapsed_s)
    expected = [
        step(*alone[axis], r, s) for axis, r, s in zip(order, readings, elapsed_s, strict=True)
    ]
    np.testing.assert_array_equal(nis, expected)
    for (mine, _, _), (other, _, _) in zip(together, alone, strict=True):
        for first, second in zip(mine, other, strict=True):
            np.testing.assert_array_equal(first, second)
    assert together[0][0].mean[0, 0] != np.log(FRESH)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda axes, rows, s: (axes, rows[:, 1:], s),
        lambda axes, rows, s: (axes, rows, s[1:]),
        lambda axes, rows, s: (axes + 1, rows, s),
        lambda axes, rows, s: (axes - 1, rows, s),
    ],
)
def test_what_does_not_belong_together_is_refused(
    spoil: Callable[..., tuple[np.ndarray, ...]],
) -> None:
    good = (np.arange(AXES), np.ones((AXES, READING_SIZE)), np.ones(AXES))
    with pytest.raises(ValueError, match=r"shapes|axes are"):
        MixtureBatch(axes()).step(*spoil(*good))


def test_a_batch_without_axes_is_refused() -> None:
    with pytest.raises(ValueError, match="needs an axis"):
        MixtureBatch([])
