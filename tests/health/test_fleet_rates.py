"""Axes that wear faster than their kind are found, and like axes are not accused."""

import numpy as np
import pytest
from scipy.special import stdtr

from edge_service.health.trend.fleet_rates import DOUBT, WearRate, against_peers

FLEETS = 1000


def like_fleet(rng: np.random.Generator, axes: int, spread: float, sigma: float) -> list[WearRate]:
    """Axes of one kind: true losses around 10, and errors of measurement."""
    losses = 10.0 + spread * rng.normal(size=axes) + sigma * rng.normal(size=axes)
    return [WearRate(float(loss), sigma) for loss in losses]


@pytest.mark.parametrize(("axes", "spread"), [(4, 2.0), (6, 2.0), (20, 2.0), (6, 0.0)])
def test_like_axes_are_seldom_accused(axes: int, spread: float) -> None:
    rng = np.random.default_rng(7)
    accused = sum(
        any(verdict is not None and verdict.faster for verdict in against_peers(fleet))
        for fleet in (like_fleet(rng, axes, spread, 0.5) for _ in range(FLEETS))
    )
    # the bound is DOUBT for each fleet; the median of few deviations is rough, so twice that
    assert accused / FLEETS < 2.0 * DOUBT


def test_an_axis_that_wears_many_times_as_fast_is_named_alone() -> None:
    rng = np.random.default_rng(8)
    fleet = [*like_fleet(rng, 7, 1.0, 0.5), WearRate(40.0, 2.0)]
    verdicts = against_peers(fleet)
    assert [verdict is not None and verdict.faster for verdict in verdicts] == [False] * 7 + [True]
    last = verdicts[-1]
    assert last is not None
    assert last.peers == 7
    assert last.peers_loss == pytest.approx(np.median([rate.loss for rate in fleet[:-1]]))


def test_two_fast_axes_do_not_hide_each_other() -> None:
    fleet = [WearRate(10.0 + 0.2 * k, 0.3) for k in range(8)]
    verdicts = against_peers([*fleet, WearRate(60.0, 1.0), WearRate(70.0, 1.0)])
    assert [v is not None and v.faster for v in verdicts] == [False] * 8 + [True, True]


def test_a_fast_axis_that_is_hardly_measured_is_not_accused() -> None:
    fleet = [WearRate(10.0 + 0.2 * k, 0.3) for k in range(8)]
    verdict = against_peers([*fleet, WearRate(40.0, 30.0)])[-1]
    assert verdict is not None
    assert not verdict.faster
    assert verdict.probability > 0.5


def test_with_few_peers_nothing_is_said() -> None:
    assert against_peers([WearRate(1.0, 0.1)] * 3) == [None, None, None]
    assert against_peers([]) == []


def test_equal_axes_without_error_are_equal() -> None:
    verdicts = against_peers([WearRate(5.0, 0.0)] * 5)
    assert all(v is not None and v.probability == 0.5 and not v.faster for v in verdicts)


def by_definition(rates: list[WearRate], index: int) -> tuple[float, float]:
    """Median of the others and the spread that they show, as the docstring states it."""
    others = [rate for k, rate in enumerate(rates) if k != index]
    middle = float(np.median([rate.loss for rate in others]))
    deviations = [abs(rate.loss - middle) for rate in others]
    seen = 1.4826 * float(np.median(deviations))
    return middle, max(seen, float(np.median([rate.sigma for rate in others])))


@pytest.mark.parametrize("axes", [4, 5, 6, 7, 30, 31])
def test_the_quick_medians_are_those_of_all_others(axes: int) -> None:
    rng = np.random.default_rng(axes)
    for step in (0.0, 5.0):
        losses = 10.0 * rng.normal(size=axes)
        losses = np.round(losses / step) if step else losses  # with ties
        rates = [WearRate(float(loss), float(rng.random())) for loss in losses]
        for index, verdict in enumerate(against_peers(rates)):
            middle, spread = by_definition(rates, index)
            assert verdict is not None
            assert verdict.peers_loss == pytest.approx(middle, abs=1e-12)
            variance = spread**2 * (1.0 + np.pi / 2.0 / (axes - 1)) + rates[index].sigma ** 2
            score = (rates[index].loss - middle) / np.sqrt(variance)
            assert verdict.probability == pytest.approx(stdtr(axes - 2, score), rel=1e-9)


def test_ten_thousand_axes_are_compared_at_once() -> None:
    rng = np.random.default_rng(9)
    fleet = [*like_fleet(rng, 9_999, 2.0, 0.5), WearRate(90.0, 1.0)]
    verdicts = against_peers(fleet)
    assert [k for k, each in enumerate(verdicts) if each is not None and each.faster] == [9_999]
