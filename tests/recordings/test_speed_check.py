"""A speed in a wrong unit shows against its position."""

import numpy as np
import pytest

from edge_service.messages.channels import TABLE_POSITION, TABLE_SPEED
from edge_service.messages.samples import SampleFrame
from edge_service.recordings.signals.speed_check import SpeedCheck

TIME_S = np.arange(5000) * 2e-3
POSITION = 0.1 * np.sin(TIME_S)
SPEED = 0.1 * np.cos(TIME_S)


def _remarks(position: np.ndarray, speed: np.ndarray, time_s: np.ndarray = TIME_S) -> list[str]:
    check = SpeedCheck()
    for part in np.array_split(np.arange(len(time_s)), 3):
        channels = {TABLE_POSITION: position[part], TABLE_SPEED: speed[part]}
        check.add(SampleFrame(time_s[part], channels))
    return check.remarks()


@pytest.mark.parametrize(
    ("factor", "reason"),
    [
        (60.0, "recorded per second, not per minute?"),
        (1.0 / 60.0, "recorded per minute, not per second?"),
        (360.0, "a rotary axis, in degrees and rev/min?"),
        (-1.0, "opposite signs?"),
        (7.0, "check their scales"),
    ],
)
def test_a_wrong_unit_is_reported_with_its_factor(factor: float, reason: str) -> None:
    (remark,) = _remarks(POSITION, SPEED / factor)
    assert f"{TABLE_SPEED} would have to be {factor:.3g} times" in remark
    assert reason in remark


def test_right_units_pass_quantised_held_lagging_noisy_and_with_gaps() -> None:
    rng = np.random.default_rng(7)
    held = np.repeat(np.round(POSITION[::2], 6), 2)
    lagging = np.roll(SPEED, 1) + rng.normal(0.0, 1e-3, SPEED.size)
    assert _remarks(held, lagging) == []
    missing = np.where(rng.random(SPEED.size) < 0.01, np.nan, SPEED)
    jump = TIME_S + np.where(TIME_S > 5.0, 3.0, 0.0)
    assert _remarks(POSITION + np.where(TIME_S > 5.0, 0.5, 0.0), missing, jump) == []
