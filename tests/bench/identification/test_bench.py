"""The harness on made-up intervals; then the real one, whose coverage has bounds."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from edge_service.regression.interval_estimate import around, undetermined

from .bench import IdentificationBench, Recovery, run, share_interval
from .cases import Recovered, recoveries
from .response_coverage import held

RARE = 1e-4


def made_up(bias: float, stated: float, count: int) -> list[Recovered]:
    """Estimates that scatter by 1 about 10 + bias and state another standard deviation."""
    random = np.random.default_rng(4)
    values = 10.0 + bias + random.standard_normal(count)
    return [Recovered(around(float(v), stated, "N", 1e9), 10.0) for v in values]


def test_honest_intervals_hold_the_truth_as_often_as_they_say() -> None:
    found = Recovery.of("honest", made_up(0.0, 1.0, 2000))
    assert abs(found.held / 2000 - 0.95) < 4.0 * math.sqrt(0.95 * 0.05 / 2000)
    assert found.share_low < 0.95 < found.share_high
    assert abs(found.bias_sigma) < 4.0 / math.sqrt(2000)
    assert found.width == pytest.approx(2.0 * stats.norm.ppf(0.975), rel=1e-6)
    assert found.mean == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize(
    ("bias", "stated", "share"), [(2.0, 1.0, 0.484), (0.0, 0.5, 0.673), (0.0, 2.0, 0.9999)]
)
def test_biased_and_wrongly_sized_intervals_are_seen(
    bias: float, stated: float, share: float
) -> None:
    """P(|z + b| < 1.96 s) by the normal distribution."""
    found = Recovery.of("wrong", made_up(bias, stated, 2000))
    assert found.held / 2000 == pytest.approx(share, abs=0.045)
    assert not found.share_low < 0.95 < found.share_high
    assert found.bias_sigma == pytest.approx(bias / stated, abs=0.1)


def test_what_is_undetermined_holds_everything_and_has_no_width() -> None:
    found = Recovery.of("none", [Recovered(undetermined("N", "why"), 1.0)] * 3)
    assert (found.held, found.undetermined) == (3, 3)
    assert math.isnan(found.width)
    text = IdentificationBench((found,)).as_text()
    assert "3/3 (3 infinite)" in text
    values = json.loads(json.dumps(IdentificationBench((found,)).as_dict(), allow_nan=False))
    assert values["parameters"][0]["width"] is None


@pytest.mark.parametrize("held", [0, 1, 57, 60])
def test_the_share_interval_is_that_of_the_binomial(held: int) -> None:
    """Clopper and Pearson: at its bounds the count, or one further away, has 2.5 %."""
    low, high = share_interval(held, 60)
    if held > 0:
        assert stats.binom.sf(held - 1, 60, low) == pytest.approx(0.025)
    if held < 60:
        assert stats.binom.cdf(held, 60, high) == pytest.approx(0.025)
    assert low <= held / 60 <= high


def test_one_axis_finds_every_parameter_near_its_truth() -> None:
    found = recoveries(7)
    groups = {name.split(".")[0] for name in found}
    assert groups == {"rigid", "friction", "two_masses", "stretch", "stretch_with_play"}
    for name, each in found.items():
        assert each.found.determined, name
        assert abs(each.found.value - each.truth) < 5.0 * each.found.sigma, name
        assert each.truth == 0.0 or each.found.sigma < 0.05 * abs(each.truth), name


@pytest.mark.slow
def test_coverage_over_many_axes() -> None:
    bench = run(40)
    for each in bench.recoveries:
        assert each.undetermined == 0, each.name
        assert each.held >= stats.binom.ppf(RARE, each.count, 0.93), each
        assert abs(each.bias_sigma) < 1.0, each
    held = sum(each.held for each in bench.recoveries)
    count = sum(each.count for each in bench.recoveries)
    assert 0.93 < held / count < 0.985


def test_intervals_of_a_control_s_response_hold_most_truths() -> None:
    answers = [held(seed) for seed in range(4)]
    assert all(answers)
    kept = [each for answer in answers for each in answer.values()]
    assert sum(kept) >= 0.8 * len(kept)
