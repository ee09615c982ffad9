"""Tests of sums, extremes and places in compiled code, against numpy."""

import numpy as np
import pytest

from edge_service.models.reductions import greatest, least, median, places, sum_of


@pytest.mark.parametrize("size", [1, 2, 7, 100])
def test_reductions_are_those_of_numpy(size: int) -> None:
    values = np.random.default_rng(size).normal(size=size)
    kept = values.copy()
    assert sum_of(values) == pytest.approx(values.sum(), rel=1e-12, abs=1e-12)
    assert (least(values), greatest(values)) == (values.min(), values.max())
    assert median(values) == np.median(values)
    assert places(values > 0.0).tolist() == np.flatnonzero(values > 0.0).tolist()
    assert np.array_equal(values, kept)


@pytest.mark.parametrize("place", [0, 2, 4])
def test_nan_is_not_passed_over(place: int) -> None:
    values = np.arange(5.0)
    values[place] = np.nan
    assert np.isnan([sum_of(values), least(values), greatest(values)]).all()


def test_nothing_is_the_sum_of_nothing() -> None:
    assert sum_of(np.empty(0)) == 0.0
    assert places(np.zeros(3, dtype=np.bool_)).tolist() == []
