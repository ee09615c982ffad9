"""The ring of estimates against a plain list."""

import numpy as np
import pytest

from edge_service.health.history import PreloadHistory
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate

NS = 1_000_000_000


def _estimate(percent: float) -> PreloadEstimate:
    return PreloadEstimate(
        time_s=0.0,
        status=EstimateStatus.ESTIMATED,
        preload_percent=percent,
        low=percent - 1.0,
        high=percent + 2.0,
        drag_torque_nm=Interval(value=percent / 50.0, low=0.0, high=1.0),
    )


UNESTIMATED = PreloadEstimate(time_s=0.0, status=EstimateStatus.UNESTIMATED)


def test_buckets_agree_with_a_plain_calculation():
    rng = np.random.default_rng(7)
    values = rng.uniform(1.0, 9.0, 500)
    history = PreloadHistory(span_s=1000.0, step_s=1.0)
    for second, value in enumerate(values):
        history.append(second * NS, _estimate(value))
    buckets = history.buckets(100.0, 400.0, 60.0)
    assert [bucket.start_s for bucket in buckets] == [100.0, 160.0, 220.0, 280.0, 340.0]
    for bucket in buckets:
        inside = values[int(bucket.start_s) : int(bucket.start_s) + 60]
        assert bucket.samples == bucket.estimated == 60
        assert bucket.preload_percent.min == inside.min()
        assert bucket.preload_percent.max == inside.max()
        assert bucket.preload_percent.mean == pytest.approx(inside.mean())
        assert bucket.low == inside.min() - 1.0
        assert bucket.high == inside.max() + 2.0
        assert bucket.drag_torque_nm.mean == pytest.approx(inside.mean() / 50.0)


def test_empty_buckets_are_absent_and_silence_is_no_number():
    history = PreloadHistory(span_s=1000.0, step_s=1.0)
    history.append(10 * NS, _estimate(5.0))
    history.append(70 * NS, UNESTIMATED)
    first, last = history.buckets(0.0, 100.0, 10.0)
    assert (first.start_s, first.preload_percent.mean) == (10.0, 5.0)
    assert (last.start_s, last.preload_percent, last.low, last.high) == (70.0, None, None, None)
    assert (last.samples, last.estimated) == (1, 0)
    assert last.status is EstimateStatus.UNESTIMATED


def test_numbers_without_the_status_are_not_kept():
    history = PreloadHistory()
    history.append(10 * NS, _estimate(5.0).model_copy(update={"status": EstimateStatus.INVALID}))
    (bucket,) = history.buckets(0.0, 100.0, 100.0)
    assert bucket.preload_percent is None
    assert bucket.drag_torque_nm is None


def test_last_estimate_of_a_step_is_kept():
    history = PreloadHistory(span_s=100.0, step_s=1.0)
    for tenth in range(20):
        history.append(tenth * NS // 10, _estimate(float(tenth)))
    (bucket,) = history.buckets(0.0, 100.0, 100.0)
    assert bucket.samples == 2
    assert (bucket.preload_percent.min, bucket.preload_percent.max) == (9.0, 19.0)


def test_ring_keeps_the_newest_and_its_size():
    history = PreloadHistory(span_s=60.0, step_s=1.0)
    size = history._values.nbytes
    for second in range(1000):
        history.append(second * NS, _estimate(float(second)))
    (bucket,) = history.buckets(0.0, 2000.0, 2000.0)
    assert bucket.samples == 60
    assert (bucket.preload_percent.min, bucket.preload_percent.max) == (940.0, 999.0)
    assert history._values.nbytes == size


def test_clock_set_back_mixes_nothing_up():
    history = PreloadHistory(span_s=100.0, step_s=1.0)
    for second in (50, 51, 52, 20, 21):
        history.append(second * NS, _estimate(float(second)))
    means = [bucket.preload_percent.mean for bucket in history.buckets(0.0, 100.0, 1.0)]
    assert means == [20.0, 21.0, 50.0, 51.0, 52.0]


def test_nothing_heard_is_an_empty_history():
    assert PreloadHistory().buckets(0.0, 1e9, 3600.0) == ()
