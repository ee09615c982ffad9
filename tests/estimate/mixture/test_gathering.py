"""Short intervals are gathered without a loss, and what waits does not outlive its clock."""

import json
import math
from dataclasses import replace

import pytest

from edge_service.downsample.statistics import absent_block
from edge_service.estimate.mixture.gathering import WHOLE_S, Gathering
from edge_service.messages.features import Fault, FeatureBlock, Phase


def block(number: int, duration_s: float, torque_nm: float, direction: float = 1.0) -> FeatureBlock:
    """The interval of that number, cruising for all of its time."""
    empty = absent_block(number, duration_s, Fault.NONE)
    cruising = Phase(duration_s, torque_nm, 0.0, direction * 10.0, number * 0.1, math.nan)
    return replace(empty, steady_direction=direction, cruising=cruising)


def test_a_mean_over_short_intervals_is_that_of_all_their_time() -> None:
    gathering = Gathering()
    done = [gathering.take(block(k, 0.02, float(k))) for k in range(5)]
    assert [len(each) for each in done] == [0, 0, 0, 0, 1]
    interval = done[-1][0]
    assert interval.duration_s == pytest.approx(WHOLE_S)
    assert interval.phases[1].steady_s == pytest.approx(0.1)
    assert interval.phases[1].torque_nm == pytest.approx((0 + 1 + 2 + 3 + 4) / 5)


def test_an_interval_of_a_tenth_of_a_second_does_not_wait() -> None:
    assert len(Gathering().take(block(0, 0.1, 1.0))) == 1


def test_another_direction_and_a_gap_end_what_waits() -> None:
    for following in (block(1, 0.02, 5.0, -1.0), block(9, 0.02, 5.0)):
        gathering = Gathering()
        assert not gathering.take(block(0, 0.02, 1.0))
        (first,) = gathering.take(following)
        assert first.phases[1].torque_nm == 1.0


def test_what_waits_goes_on_from_a_snapshot() -> None:
    gathering, other = Gathering(), Gathering()
    for k in range(3):
        gathering.take(block(k, 0.02, float(k)))
    other.restore(json.loads(json.dumps(gathering.snapshot(), allow_nan=False)))
    for k in range(3, 5):
        one, two = gathering.take(block(k, 0.02, 1.0)), other.take(block(k, 0.02, 1.0))
        assert [each.duration_s for each in one] == [each.duration_s for each in two]
        for mine, its in zip(one, two, strict=True):
            assert mine.phases[1].torque_nm == its.phases[1].torque_nm
