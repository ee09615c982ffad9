"""The simulated accelerometer: rates, orders and ringing as stated."""

import itertools
import math

import numpy as np
import pytest

from edge_service.messages.samples import Floats
from edge_service.models.plant.accelerometer import (
    REFERENCE_SPEED_RAD_S,
    Accelerometer,
    AccelerometerSettings,
)

SPEED = 2.0 * math.pi * 5.0
QUIET = {"noise": 0.0, "ball_pass": 0.0}


def follow(settings: AccelerometerSettings, seconds: float = 2.0, block: int = 20) -> Floats:
    time_s = np.arange(round(1000 * seconds)) / 1000.0
    sensor = Accelerometer(settings, 1)
    waves = [
        sensor.follow(time_s[k : k + block], SPEED * time_s[k : k + block])
        for k in range(0, len(time_s), block)
    ]
    for before, after in itertools.pairwise(waves):
        assert after.start_s == pytest.approx(before.end_s, abs=1e-9)
    return np.concatenate([wave.values for wave in waves])


@pytest.mark.parametrize("rate_hz", [10_000.0, 25_600.0])
def test_values_come_at_the_sensor_s_own_rate_without_a_hole(rate_hz: float) -> None:
    values = follow(AccelerometerSettings(rate_hz=rate_hz))
    assert len(values) == pytest.approx(2.0 * rate_hz, abs=rate_hz / 900.0)


def test_any_split_gives_the_same_signal() -> None:
    settings = AccelerometerSettings(damage=3.0, noise=0.0)
    np.testing.assert_allclose(follow(settings, block=20), follow(settings, block=7), atol=1e-9)


def test_the_tone_stands_at_the_ball_pass_frequency() -> None:
    settings = AccelerometerSettings(noise=0.0, ball_pass=1.0, ball_pass_order=9.56)
    values = follow(settings)
    spectrum = np.abs(np.fft.rfft(values * np.hanning(len(values))))
    frequency = np.fft.rfftfreq(len(values), 1e-4)
    assert frequency[np.argmax(spectrum)] == pytest.approx(9.56 * 5.0, abs=0.5)
    assert np.max(values) == pytest.approx(SPEED / REFERENCE_SPEED_RAD_S, rel=0.01)


def test_every_ball_strikes_the_pit_once_and_it_rings_out() -> None:
    settings = AccelerometerSettings(**QUIET, damage=2.0, ball_pass_order=10.0)
    values = follow(settings)
    loud = np.flatnonzero(np.abs(values) > 0.3)
    strikes = loud[np.concatenate([[True], np.diff(loud) > 100])]
    assert len(strikes) == pytest.approx(10.0 * 5.0 * 2.0, abs=2)
    step_s = np.median(np.diff(strikes)) / 10_000.0
    assert step_s == pytest.approx(1.0 / 50.0, rel=0.01)
    swing = np.max(np.abs(values))
    expected = 2.0 * SPEED / REFERENCE_SPEED_RAD_S
    assert 0.7 * expected < swing < 1.05 * expected
