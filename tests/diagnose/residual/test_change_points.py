"""Raised stretches are found where they were put."""

import numpy as np
import pytest

from edge_service.diagnose.localisation import raised_intervals


def level_of(*spans: tuple[int, int]) -> np.ndarray:
    level = 0.05 * np.random.default_rng(2).random(90)
    for low, high in spans:
        level[low:high] += 1.0
    return level


@pytest.mark.parametrize("span", [(0, 10), (30, 60), (80, 90), (41, 42)])
def test_one_stretch(span: tuple[int, int]) -> None:
    assert raised_intervals(level_of(span), np.ones(90)) == [span]


def test_two_stretches_are_two_and_not_what_lies_between() -> None:
    assert sorted(raised_intervals(level_of((5, 20), (70, 85)), np.ones(90))) == [(5, 20), (70, 85)]


def test_a_constant_level_is_one_stretch() -> None:
    assert raised_intervals(np.ones(50), np.ones(50)) == [(0, 50)]


def test_cells_without_weight_do_not_count() -> None:
    weight = np.ones(90)
    weight[60:] = 0.0
    assert raised_intervals(level_of((30, 60), (70, 80)), weight)[0][0] == 30
