"""Chirp and multisine: spectrum, bounds, and that they never turn back."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.motions.excitation import Chirp, Multisine, Shaken, Wave
from edge_service.models.motions.registry import MOTIONS, MotionLimits

BENCH = MotionLimits(0.04, 0.76)
CHIRP = Chirp(5.0, 300.0, 20.0, 2.0, 4.0)


def shaken(name: str) -> list[Shaken]:
    segments = MOTIONS[name](BENCH, np.random.default_rng(1))
    return [each for each in segments if isinstance(each, Shaken)]


def random_multisine(seed: int) -> Multisine:
    random = np.random.default_rng(seed)
    return Multisine(np.arange(5.0, 61.0), random.uniform(0.0, 6.0, 56), 0.1, 1.0, 3.0)


@pytest.mark.parametrize("wave", [CHIRP, random_multisine(1)], ids=["chirp", "multisine"])
def test_speed_and_acceleration_are_the_derivatives_of_travel(wave: Wave) -> None:
    h = 1e-6
    time_s = np.linspace(2 * h, wave.duration_s - 2 * h, 500)
    before, at, after = (wave.motion(time_s + shift) for shift in (-h, 0.0, h))
    slope = (after - before) / (2.0 * h)
    scale = np.abs(at).max(axis=0)
    assert np.abs(slope[:, 0] - at[:, 1]).max() < 1e-5 * scale[1]
    assert np.abs(slope[:, 1] - at[:, 2]).max() < 1e-5 * scale[2]


@pytest.mark.parametrize("name", ["chirp", "multisine"])
def test_the_fades_keep_the_derivatives_right(name: str) -> None:
    segment = shaken(name)[0]
    h = 1e-6
    begin_s, end_s = segment.wave_starts_s, segment.wave_starts_s + segment.wave.duration_s
    for first, last in ((begin_s, begin_s + 0.6), (end_s - 0.6, end_s)):
        time_s = np.linspace(first + h, last - h, 300)
        before, at, after = (segment.setpoints(time_s + shift) for shift in (-h, 0.0, h))
        slope = (after - before) / (2.0 * h)
        assert np.abs(slope[:, 0] - at[:, 1]).max() < 1e-7
        assert np.abs(slope[:, 1] - at[:, 2]).max() < 1e-4


@given(
    low=st.floats(1.0, 20.0),
    width=st.floats(2.0, 60.0),
    corner=st.floats(1.0, 100.0),
    duration=st.floats(1.0, 30.0),
)
@settings(max_examples=30, deadline=None)
def test_a_chirp_keeps_the_bounds_it_states(
    low: float, width: float, corner: float, duration: float
) -> None:
    wave = Chirp(low, width * low, corner, 2.0, duration)
    time_s = np.random.default_rng(0).uniform(0.0, duration, 20_000)
    reached = np.abs(wave.motion(time_s)).max(axis=0)
    assert (reached <= np.array(wave.peaks) * (1.0 + 1e-9)).all()


@given(st.integers(0, 1000))
@settings(max_examples=10, deadline=None)
def test_a_multisine_keeps_the_bounds_it_states_and_they_are_tight(seed: int) -> None:
    wave = random_multisine(seed)
    reached = np.abs(wave.motion(np.linspace(0.0, 1.0, 5_001))).max(axis=0)
    assert (reached <= np.array(wave.peaks)).all()
    assert (reached >= 0.95 * np.array(wave.peaks)).all()


@pytest.mark.parametrize("name", ["chirp", "multisine"])
def test_faded_bounds_hold_and_the_axis_never_turns_back(name: str) -> None:
    for segment in shaken(name):
        time_s = np.arange(0.0, segment.duration_s, 1.0 / 1009.0)
        _, speed, acceleration = segment.setpoints(time_s).T
        assert np.abs(speed).max() <= segment.peak_speed_m_s
        assert np.abs(acceleration).max() <= segment.peak_acceleration_m_s2
        moving = time_s > segment.wave_starts_s
        moving &= time_s < segment.wave_starts_s + segment.wave.duration_s
        forward = speed[moving] * math.copysign(1.0, segment.distance_m)
        assert forward.min() >= 0.2 * segment.carrier.speed_m_s * (1.0 - 1e-9)


def test_the_chirp_sweeps_from_5_to_300_hz() -> None:
    wave = shaken("chirp")[0].wave
    assert isinstance(wave, Chirp)
    ends = wave.frequency_hz(np.array([0.0, wave.duration_s]))
    assert ends == pytest.approx([5.0, 300.0])
    time_s = np.arange(0.0, 0.6 * wave.duration_s, 2e-5)
    crossings = np.flatnonzero(np.diff(np.sign(wave.motion(time_s)[:, 0])) != 0)
    counted_hz = 0.5 / np.diff(time_s[crossings])
    middles_s = 0.5 * (time_s[crossings][1:] + time_s[crossings][:-1])
    wanted_hz = 5.0 * 60.0 ** (middles_s / 20.0)
    assert counted_hz == pytest.approx(wanted_hz, rel=0.02)


def test_the_multisine_has_equal_lines_at_every_hertz_from_5_to_300() -> None:
    segment = shaken("multisine")[0]
    first_s = segment.wave_starts_s + segment.fade_s
    time_s = first_s + np.arange(1000) / 1000.0
    acceleration = segment.setpoints(time_s)[:, 2]
    lines = 2.0 * np.abs(np.fft.rfft(acceleration)) / 1000.0
    assert lines[5:301] == pytest.approx(np.full(296, lines[5:301].mean()), rel=1e-6)
    assert np.delete(lines, np.arange(5, 301)).max() < 1e-6 * lines[5]
    again = segment.setpoints(time_s + 9.0)[:, 2]
    assert again == pytest.approx(acceleration, abs=1e-9)


def test_the_multisine_has_a_low_crest_and_each_way_its_own_phases() -> None:
    there, back = (each.wave for each in shaken("multisine"))
    for wave in (there, back):
        acceleration = wave.motion(np.arange(4800) / 4800.0)[:, 2]
        assert np.abs(acceleration).max() / acceleration.std() < 1.8
    assert isinstance(there, Multisine)
    assert isinstance(back, Multisine)
    assert not np.allclose(there.phases_rad, back.phases_rad)


def test_a_short_stroke_slows_the_feed_and_weakens_the_wave() -> None:
    short = MotionLimits(0.01, 0.06)
    segments = list(MOTIONS["chirp"](short, np.random.default_rng(1)))
    weak = next(each for each in segments if isinstance(each, Shaken))
    strong = shaken("chirp")[0]
    assert abs(weak.distance_m) < short.span_m
    assert weak.wave.peaks[2] < 0.2 * strong.wave.peaks[2]
