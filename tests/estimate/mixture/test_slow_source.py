"""Sources slower than a drive: learned from their own recordings, or not read at all."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

from .production import AXIS, FRESH, held, numbers, run


def thinned(frames: Iterator[SampleFrame], every: int, of: Machine) -> list[FeatureBlock]:
    """Blocks of every n-th sample: points of what goes on, as a slow poll reads them."""
    downsampler = Downsampler(DownsampleSettings(), of.transmission_ratio_m_per_rad)
    blocks, begin = [], 0
    for frame in frames:
        rows = slice(-begin % every, None, every)
        begin += len(frame)
        channels = {name: values[rows] for name, values in frame.channels.items()}
        blocks += downsampler.push(SampleFrame(frame.time_s[rows], channels))
    return blocks


def own(percent: float, seed: int, every: int) -> list[FeatureBlock]:
    frames = AXIS.frames("production", np.full(90_000, percent), seed)
    return thinned(frames, every, AXIS.nominal())


@cache
def slow_machine(every: int) -> Machine:
    return commissioned([own(FRESH, 3, every)], AXIS.nominal())


def test_samples_slower_than_those_of_commissioning_are_not_read() -> None:
    said = run(own(FRESH, 5, 10))
    assert not len(numbers(said))
    assert all(each.status is not EstimateStatus.INVALID for each in said)
    moved = [each for each in said if each.time_s > 5.0]
    assert {each.status for each in moved} == {EstimateStatus.UNESTIMATED}
    assert all(each.reasons[0].startswith("too_slow: 100 samples/s") for each in moved)


def test_slow_samples_in_between_leave_a_number_for_a_while_and_no_accusation() -> None:
    quick, slow = own(FRESH, 6, 1)[:300], own(FRESH, 6, 20)[300:600]
    said = run([*quick, *slow])
    assert said[299].status is EstimateStatus.ESTIMATED
    assert said[-1].status is EstimateStatus.UNESTIMATED
    assert said[-1].reasons[0].startswith("too_slow: 50 samples/s")


@pytest.mark.slow
@pytest.mark.parametrize("every", [10, 20])
@pytest.mark.parametrize("share", [1.0, 0.6, 0.3])
def test_an_axis_commissioned_from_slow_samples_is_read_from_them(every: int, share: float) -> None:
    percent = share * FRESH
    of = slow_machine(every)
    assert of.commissioned is not None
    assert of.commissioned.sample_period_s == pytest.approx(every / 1000.0)
    answers = numbers(run(own(percent, 7, every), MixturePreloadEstimator(of)))
    late = answers[answers[:, 0] > 20.0]
    assert len(late) > 500
    assert held(late, percent) > 0.95
