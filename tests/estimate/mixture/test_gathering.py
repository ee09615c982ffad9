"""Short intervals are gathered without a loss."""

import math
from dataclasses import replace

import pytest

from edge_service.downsample.statistics import absent_block
from edge_service.estimate.mixture.gathering import WHOLE_S, gathered
from edge_service.messages.features import Fault, FeatureBlock, Phase


def block(number: int, duration_s: float, torque_nm: float, direction: float = 1.0) -> FeatureBlock:
    """The interval of that number, cruising for all of its time."""
    empty = absent_block(number, duration_s, Fault.NONE)
    cruising = Phase(duration_s, torque_nm, 0.0, direction * 10.0, number * 0.1, math.nan)
    return replace(empty, steady_direction=direction, cruising=cruising)


def test_a_mean_over_short_intervals_is_that_of_all_their_time() -> None:
    waiting = None
    for k in range(5):
        done, waiting = gathered(waiting, block(k, 0.02, float(k)))
        assert len(done) == (k == 4)
    assert waiting is None
    assert done[0].duration_s == pytest.approx(WHOLE_S)
    assert done[0].phases[1].steady_s == pytest.approx(0.1)
    assert done[0].phases[1].torque_nm == pytest.approx((0 + 1 + 2 + 3 + 4) / 5)


@pytest.mark.parametrize("after", [block(1, 0.02, 5.0, -1.0), block(9, 0.02, 5.0)])
def test_another_direction_and_a_gap_end_what_waits(after: FeatureBlock) -> None:
    _, waiting = gathered(None, block(0, 0.02, 1.0))
    (first,), waiting = gathered(waiting, after)
    assert first.phases[1].torque_nm == 1.0
    assert waiting is not None
