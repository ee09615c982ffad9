"""Wear of any rate within one session."""

import math

import numpy as np
import pytest

from edge_service.messages.samples import Floats

from ..scores import Track
from .wear_rates import (
    QUICK_RATES_PER_MIN,
    RATES_PER_MIN,
    loss_seen,
    preload,
    rate_section,
    rate_session,
    scored,
)

FRESH = 6.0


def falling(high_error: Floats, per_row: float = 0.1) -> Track:
    """A row each second, half of it in motion; the truth falls from the 20th row on."""
    time_s = np.arange(1.0, len(high_error) + 1.0)
    truth = FRESH - per_row * np.maximum(np.arange(len(time_s)) - 19.0, 0.0)
    high = truth + high_error
    return Track(time_s, truth, high - 0.2, high - 0.4, high, 0.5 * time_s)


def test_the_rates_go_from_none_to_all_within_a_minute() -> None:
    worn = [rate for rate in RATES_PER_MIN if 0.0 < rate < math.inf]
    assert np.log10(worn) == pytest.approx([-3.0, -2.0, -1.0, 0.0])
    assert (RATES_PER_MIN[0], RATES_PER_MIN[-1]) == (0.0, math.inf)
    assert set(QUICK_RATES_PER_MIN) <= set(RATES_PER_MIN)


def test_preload_falls_at_its_rate_and_ends_at_none() -> None:
    time_s, percent = preload(1.0, FRESH, 180.0)
    assert np.interp([30.0, 60.0, 120.0, 180.0], time_s, percent) == pytest.approx([6, 6, 5, 4])
    time_s, percent = preload(math.inf, FRESH, 180.0)
    assert np.interp([60.0, 90.0, 120.0, 180.0], time_s, percent) == pytest.approx([6, 3, 0, 0])
    _, percent = preload(0.0, FRESH, 180.0)
    assert (percent == FRESH).all()


def test_a_loss_is_seen_when_ten_intervals_in_a_row_lie_below_half_of_it() -> None:
    # half a point is lost at row 24; intervals that end .1 above the truth pass .25 at row 23
    assert loss_seen(falling(np.full(60, 0.1)), FRESH) == (0.0, False)
    # 1 above the truth: 13 rows of .1 after the beginning lie below 6 - .25
    late = loss_seen(falling(np.full(60, 1.0)), FRESH)
    assert late == (pytest.approx(0.5 * (32 - 24)), False)
    assert loss_seen(falling(np.full(60, 9.0)), FRESH) == (math.inf, False)
    assert math.isnan(loss_seen(falling(np.full(22, 0.1)), FRESH)[0])


def test_what_is_seen_before_anything_was_lost_is_early() -> None:
    error = np.where(np.arange(60) < 15, -0.5, 0.1)
    assert loss_seen(falling(error), FRESH) == (0.0, True)
    short = np.where(np.arange(60) < 9, -0.5, 9.0)
    assert loss_seen(falling(short), FRESH) == (math.inf, False)


def test_the_end_is_the_mean_of_the_last_ten_seconds() -> None:
    part = scored(falling(np.full(60, 0.5)), 6.0, False, 3, FRESH)
    assert part.end_error == pytest.approx(0.3)
    lost = 0.1 * np.maximum(np.arange(60) - 19.0, 0.0)
    assert part.fresh_mae == pytest.approx(lost.mean())
    assert part.score.wrong == 0.0
    table = rate_section([part]).as_text()
    assert "6 points/min, cold" in table


@pytest.mark.slow
def test_a_short_session_of_each_rate() -> None:
    parts = list(rate_session(3, False, True))
    assert [part.rate_per_min for part in parts] == list(QUICK_RATES_PER_MIN)
    healthy, _, lost = parts
    assert math.isnan(healthy.seen_s)
    assert math.isfinite(lost.seen_s)
    assert np.isfinite(lost.track.percent).mean() > 0.9
