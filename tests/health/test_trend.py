"""The trend against lines whose slope and crossing are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from edge_service.health.alarms import slowest_loss
from edge_service.health.wear.trend import MOST_POINTS, PreloadHistory, as_of, preload_trend
from edge_service.messages.trend import TrendStatus

from ..bench.estimator.dates import LAWS, ask_healthy, ask_of_a_law

DAY_S = 86400.0
NS = 1_000_000_000
LIMITS = {"warning": 4.2, "fault": 2.1}
SHIFT_S, HALF_WIDTH = 600, 0.6


def _wandering(rng: np.random.Generator, memory_s: float) -> np.ndarray:
    """Errors of an estimator in a shift, one a second, as large as its interval says, (n,)."""
    keep = np.exp(-1.0 / memory_s)
    pushes = rng.standard_normal(SHIFT_S) * np.sqrt(1.0 - keep**2)
    pushes[0] = rng.standard_normal()
    return HALF_WIDTH / 1.96 * lfilter([1.0], [1.0, -keep], pushes)


def _rate_of_shift(percent: np.ndarray, half_width: np.ndarray | float = HALF_WIDTH):
    """Of estimates of which one comes every second."""
    history = PreloadHistory()
    widths = np.broadcast_to(half_width, percent.shape)
    for second, (value, width) in enumerate(zip(percent.tolist(), widths.tolist(), strict=True)):
        history.add(float(second), value, width, 0.2 * second)
    return preload_trend(*history.points(), LIMITS).rate_percent_per_h


@pytest.mark.parametrize("memory_s", [60.0, 300.0, 1200.0])
def test_an_estimator_that_errs_within_its_interval_raises_no_alarm_of_the_rate(memory_s):
    rng = np.random.default_rng([5, int(memory_s)])
    shifts = [6.5 + _wandering(rng, memory_s)[:look] for _ in range(25) for look in (200, SHIFT_S)]
    assert min(slowest_loss(_rate_of_shift(each)) for each in shifts) > 0.0


def test_a_loss_of_half_the_preload_in_a_shift_is_an_alarm_of_the_rate():
    rng = np.random.default_rng(6)
    for _ in range(5):
        percent = np.linspace(6.8, 3.4, SHIFT_S) + 0.3 * _wandering(rng, 300.0)
        assert slowest_loss(_rate_of_shift(percent)) < 0.0


@pytest.mark.parametrize("seed", range(5))
def test_a_dip_that_its_own_interval_covers_is_no_alarm_of_the_rate(seed):
    """As while new grease spreads: a jump of the last seconds, after minutes without scatter."""
    rng = np.random.default_rng([7, seed])
    time_s = np.arange(312.0)
    percent = 6.8 + 0.08 * np.sin(time_s / 40.0 + seed) + 0.006 * rng.standard_normal(time_s.size)
    half_width = np.full(time_s.size, 0.5)
    percent[-10:-5] -= 0.1 + 0.08 * np.arange(5.0)
    half_width[-10:-5] = 1.45
    percent[-5:] -= 0.9
    half_width[-5:] = 0.91
    assert slowest_loss(_rate_of_shift(percent, half_width)) > 0.0


def _trend(days: np.ndarray, percent: np.ndarray, distance_m: np.ndarray | None = None):
    way_m = np.full(days.size, np.nan) if distance_m is None else distance_m
    return preload_trend(days * DAY_S, percent, np.full(days.size, 0.1), way_m, LIMITS)


def test_a_straight_loss_gives_its_rate_and_its_date():
    rng = np.random.default_rng(1)
    days = np.arange(100.0)
    trend = _trend(days, 7.0 - 0.02 * days + 0.03 * rng.standard_normal(100))
    assert trend.status is TrendStatus.FALLING
    per_day = trend.rate_percent_per_h
    assert per_day.low * 24 < -0.02 < per_day.high * 24
    warning, fault = trend.crossings
    assert (warning.limit, fault.limit) == ("warning", "fault")
    for crossing, day in ((warning, 140.0), (fault, 245.0)):
        assert crossing.earliest_ns < day * DAY_S * NS < crossing.latest_ns
        assert crossing.earliest_ns <= crossing.likely_ns <= crossing.latest_ns


def test_a_healthy_year_has_no_date_and_no_alarm_and_rarely_a_fall():
    """Errors of the session, the weeks and the season, asked after each of 16 sessions."""
    asked = list(ask_healthy(range(500, 506)))
    assert len(asked) == 6 * 16
    assert not any(each.dated or each.alarmed for each in asked)
    assert sum(each.falling for each in asked) <= 5


def test_two_sessions_that_differ_by_less_than_the_interval_are_no_trend():
    """All estimates of a session err alike, however many there are."""
    rng = np.random.default_rng(21)
    time_s = np.concatenate([np.arange(30.0), 10.0 * DAY_S + np.arange(30.0)])
    percent = 7.0 - 0.3 * (time_s > DAY_S) + 0.01 * rng.standard_normal(60)
    trend = preload_trend(time_s, percent, np.full(60, 0.3), np.full(60, np.nan), LIMITS)
    assert trend.status is TrendStatus.STEADY


def _minutes(change: float, half_width: float):
    """Ten minutes in which the preload falls evenly, by estimates of one interval."""
    time_s = np.arange(0.0, 600.0, 4.0)
    percent = 6.8 - change * time_s / 600.0
    percent = percent + 0.01 * np.random.default_rng(10).standard_normal(time_s.size)
    width, unknown = np.full(time_s.size, half_width), np.full(time_s.size, np.nan)
    return preload_trend(time_s, percent, width, unknown, LIMITS)


def test_a_quick_change_within_the_interval_may_be_the_estimators_own():
    assert _minutes(0.1, 0.05).status is TrendStatus.FALLING
    assert _minutes(0.1, 1.7).status is TrendStatus.STEADY
    lost = _minutes(5.0, 1.7)
    assert lost.status is TrendStatus.FALLING
    per_h = lost.rate_percent_per_h
    # both ends err on their own: the interval holds half_width * sqrt(2) on either side, at 95 %
    assert per_h.high - per_h.low > 2.0 * 1.7 * np.sqrt(2.0) * 6.0 * 1.645 / 1.96 * 0.9


def test_estimates_that_only_begin_to_know_are_no_history():
    rng = np.random.default_rng(11)
    days = np.arange(100.0)
    percent = 7.0 + 0.03 * rng.standard_normal(100)
    width = np.full(100, 0.1)
    percent[:8], width[:8] = 9.0, 2.0
    trend = preload_trend(days * DAY_S, percent, width, np.full(100, np.nan), LIMITS)
    assert trend.status is TrendStatus.STEADY
    assert trend.since_time_ns == round(8.0 * DAY_S * NS)


def test_too_little_history_is_said():
    trend = _trend(np.arange(4.0), np.linspace(7.0, 6.0, 4))
    assert trend.status is TrendStatus.TOO_EARLY
    assert trend.rate_percent_per_h is None
    close = _trend(np.arange(20.0) / 3600.0, np.linspace(7.0, 6.0, 20))
    assert close.status is TrendStatus.TOO_EARLY


def test_a_few_points_far_apart_are_history_enough():
    rng = np.random.default_rng(12)
    days = np.arange(8.0)
    trend = _trend(days, 7.0 - 0.2 * days + 0.05 * rng.standard_normal(8))
    assert trend.status is TrendStatus.FALLING
    (warning, _) = trend.crossings
    assert warning.earliest_ns < 14.0 * DAY_S * NS < warning.latest_ns


@pytest.mark.parametrize("power", [0.6, 1.0, 1.8])
def test_wear_that_slows_down_or_speeds_up_is_dated(power):
    rng = np.random.default_rng(13)
    days = np.arange(40.0)
    percent = 7.0 - 1.6 * (days / 40.0) ** power + 0.03 * rng.standard_normal(40)
    day = 40.0 * (2.8 / 1.6) ** (1.0 / power)
    warning = _trend(days, percent).crossings[0]
    assert warning.earliest_ns < day * DAY_S * NS < warning.latest_ns
    assert 0.7 * day < warning.likely_ns / NS / DAY_S < 1.4 * day


def test_the_way_ahead_is_that_of_the_newest_use():
    """Twice the speed since the last quarter: the date by the way comes sooner than by the hour."""
    rng = np.random.default_rng(14)
    days = np.arange(40.0)
    way_m = 1000.0 * np.where(days < 30.0, days, 30.0 + 4.0 * (days - 30.0))
    percent = 7.0 - 2.0e-5 * way_m + 0.02 * rng.standard_normal(40)
    warning = _trend(days, percent, way_m).crossings[0]
    left_days = (2.8 / 2.0e-5 - way_m[-1]) / 4000.0
    likely_days = warning.likely_ns / NS / DAY_S - 39.0
    assert likely_days == pytest.approx(left_days, rel=0.3)


def test_a_rise_is_told_and_has_no_date():
    rng = np.random.default_rng(4)
    days = np.arange(60.0)
    trend = _trend(days, 5.0 + 0.02 * days + 0.02 * rng.standard_normal(60))
    assert trend.status is TrendStatus.RISING
    assert trend.crossings == ()


def test_after_running_in_the_later_rate_counts():
    rng = np.random.default_rng(5)
    days = np.arange(200.0)
    truth = np.where(days < 40.0, 9.0 - 0.05 * days, 7.0 - 0.01 * (days - 40.0))
    trend = _trend(days, truth + 0.03 * rng.standard_normal(200))
    assert trend.rate_percent_per_h.low * 24 < -0.01 < trend.rate_percent_per_h.high * 24
    crossing = trend.crossings[0]
    assert crossing.earliest_ns < (40.0 + 280.0) * DAY_S * NS < crossing.latest_ns


@pytest.mark.parametrize("now_s", [220.0, 330.0, 370.0, 420.0, 480.0, 900.0])
def test_a_fall_that_has_ended_has_soon_an_end_and_no_rate(now_s):
    """Most of the preload within 2 min, known to 25 % of fresh; the estimate settles slowly."""
    time_s = np.arange(0.0, now_s, 4.0)
    settled = 0.25 * np.exp(-np.maximum(time_s - 240.0, 0.0) / 300.0)
    percent = np.maximum(6.8 - 0.0485 * np.maximum(time_s - 120.0, 0.0), 0.73 + settled)
    none, is_over = np.full(time_s.size, np.nan), now_s > 300.0
    trend = preload_trend(time_s, percent, 0.0 * percent + 1.7, none, LIMITS)
    assert trend.until_time_ns / NS == pytest.approx(242.0 if is_over else now_s - 4.0, abs=12.0)
    assert (trend.rate_percent_per_h.high < -36.0) is not is_over
    assert bool(trend.crossings) is not is_over


@pytest.mark.parametrize("sound_s", [0.0, 120.0, 600.0, 2400.0])
def test_a_fall_before_a_stand_has_ended_however_long_all_was_well_before(sound_s):
    """A quarter of fresh within 40 s; since then the estimator wanders within its interval."""
    history, end = PreloadHistory(), int(sound_s) + 40
    errors = 0.3 * _wandering(np.random.default_rng(15), 50.0)
    for second in range(end + 240):
        fall = 1.7 * np.clip((second - sound_s) / 40.0, 0.0, 1.0)
        history.add(float(second), 6.6 - fall + errors[second % SHIFT_S], 0.25, np.nan)
    told = preload_trend(*history.points(), LIMITS, 6.85)
    assert (told.status, told.crossings) == (TrendStatus.FELL, ())
    assert told.until_time_ns / NS == pytest.approx(end, abs=max(10.0, 0.02 * end))
    assert told.rate_percent_per_h.low < 0.0 < told.rate_percent_per_h.high


def test_an_estimator_that_wanders_within_its_interval_never_falls_in_a_shift():
    rng = np.random.default_rng(16)
    for _ in range(12):
        history, percent = PreloadHistory(), 6.8 + _wandering(rng, 50.0)
        for second in range(0, SHIFT_S, 2):
            history.add(float(second), percent[second], HALF_WIDTH, np.nan)
            if second % 100 == 98:
                told = preload_trend(*history.points(), LIMITS, 6.85)
                assert told.status is not TrendStatus.FALLING


def test_no_date_of_a_limit_lies_behind():
    trend = _trend(np.arange(8.0), 7.0 - 0.2 * np.arange(8.0))
    (warning, fault) = trend.crossings
    late_ns = warning.latest_ns + NS
    told = as_of(trend.model_copy(update={"until_time_ns": late_ns}), late_ns).crossings
    assert [each.earliest_ns for each in told] == [late_ns, max(fault.earliest_ns, late_ns)]
    assert (told[0].latest_ns, told[1].latest_ns) == (None, fault.latest_ns)
    assert as_of(trend, late_ns).crossings == ()  # the newest estimate is old


def test_wear_that_follows_the_way_is_counted_against_it():
    rng = np.random.default_rng(6)
    days = np.arange(120.0)
    daily_m = np.where(days % 30 < 15, 8000.0, 200.0)
    distance_m = np.cumsum(daily_m)
    percent = 8.0 - 4e-6 * distance_m + 0.02 * rng.standard_normal(120)
    trend = _trend(days, percent, distance_m)
    assert trend.basis == "distance"
    by_time = 8.0 - 0.02 * days + 0.02 * rng.standard_normal(120)
    assert _trend(days, by_time, distance_m).basis == "time"


@pytest.mark.slow
@pytest.mark.parametrize("readings", [False, True])
def test_nine_of_ten_bands_hold_the_date_and_most_questions_have_one(readings):
    asked = [each for law in LAWS for each in ask_of_a_law(law, range(700, 710), readings=readings)]
    dated = [each for each in asked if each.scores]
    assert len(dated) > 0.75 * len(asked)
    assert 0.85 <= np.mean([each.missed == 0 for each in dated]) <= 0.95
    ours, *others = np.mean([each.scores for each in dated], axis=0)
    assert ours > max(others)


def test_the_series_stays_short_and_keeps_means():
    series = PreloadHistory()
    values = np.random.default_rng(9).uniform(5.0, 6.0, 5000)
    for second, value in enumerate(values.tolist()):
        series.add(second + 0.25, value, 0.2, 3.0 * second)
    time_s, percent, half_width, distance_m = series.points()
    assert time_s.size <= MOST_POINTS
    step_s = round(time_s[1] - time_s[0])
    whole = values[: 5000 // step_s * step_s].reshape(-1, step_s).mean(axis=1)
    np.testing.assert_allclose(percent[: whole.size], whole)
    np.testing.assert_allclose(half_width, 0.2)
    np.testing.assert_allclose(distance_m[:-1], 3.0 * (time_s[:-1] - 0.5))


def test_the_series_goes_on_from_its_snapshot():
    series, other = PreloadHistory(), PreloadHistory()
    for second in range(700):
        series.add(float(second), 5.0 + second, 0.1, 0.0)
    other.restore(series.snapshot())
    for each in (series, other):
        each.add(800.0, 9.0, 0.1, 0.0)
    for mine, theirs in zip(series.points(), other.points(), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    rows = np.array([[2.0, 1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0, 1.0]])
    with pytest.raises(ValueError, match="order"):
        other.restore(replace(series.snapshot(), rows=rows))
