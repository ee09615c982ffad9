"""Slow samples, and frames that wait: what they do not allow is said, and no block comes later."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.downsample.rows import MOST_FRAMES, Gathering
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.samples import (
    ANGLE,
    TABLE_POSITION,
    TORQUE,
    Floats,
    Quality,
    SampleFrame,
)

from .test_downsampler import RATIO, frame_of, trace

RATIO_M_PER_RAD = 0.02 / (2.0 * np.pi)
SPEED_RAD_S = 20.0
TORQUE_NM = 0.15
cuts = st.lists(st.integers(1, 1999), max_size=60)


def frame(time_s: Floats) -> SampleFrame:
    angle = SPEED_RAD_S * time_s
    torque = TORQUE_NM + 0.01 * np.sin(7.0 * time_s)
    return SampleFrame(
        time_s, {TORQUE: torque, ANGLE: angle, TABLE_POSITION: RATIO_M_PER_RAD * angle}
    )


def blocks_of(*frames: SampleFrame) -> list[FeatureBlock]:
    downsampler = Downsampler(DownsampleSettings(), RATIO_M_PER_RAD)
    return [block for each in frames for block in downsampler.push(each)]


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 25.0, 50.0, 100.0])
def test_a_slow_moving_axis_is_not_stuck_and_its_samples_are_called_sparse(rate_hz: float) -> None:
    blocks = blocks_of(frame(np.arange(int(5.0 * rate_hz)) / rate_hz))
    assert len(blocks) > 40
    sparse = rate_hz * 0.1 < 5.0
    for block in blocks:
        assert block.fault == (Fault.SPARSE if sparse else Fault.NONE)
        assert block.usable
        assert block.speed_start_rad_s == pytest.approx(SPEED_RAD_S)


@pytest.mark.parametrize("rate_hz", [50.0, 1000.0])
def test_a_stuck_channel_is_still_found(rate_hz: float) -> None:
    moving = frame(np.arange(int(3.0 * rate_hz)) / rate_hz)
    torque = moving.channels[TORQUE].copy()
    torque[int(rate_hz) : int(2 * rate_hz)] = 0.3
    stuck = SampleFrame(moving.time_s, {**moving.channels, TORQUE: torque})
    times_s = [b.time_s for b in blocks_of(stuck) if Fault.STUCK in b.fault]
    assert times_s == pytest.approx(np.arange(11, 21) / 10.0, abs=0.11)


def test_samples_that_their_source_doubts_are_reported() -> None:
    whole = frame(np.arange(3000) / 1000.0)
    codes = np.zeros(3000, dtype=np.uint8)
    codes[1010:1020] = Quality.SOURCE_UNCERTAIN
    codes[2000] = Quality.OVERFLOW
    doubted = SampleFrame(whole.time_s, whole.channels, {TORQUE: codes})
    times_s = {round(b.time_s, 1) for b in blocks_of(doubted) if Fault.DOUBTED in b.fault}
    assert times_s == {1.1, 2.1}


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
def test_torque_goes_on_between_slow_samples(rate_hz: float) -> None:
    """Torque and acceleration agree in every phase of a motion with constant jerk."""
    inertia, jerk, drag = 1.5e-3, 400.0, 0.3
    time_s = np.arange(int(2.0 * rate_hz)) / rate_hz
    angle = 30.0 * time_s + jerk * time_s**3 / 6.0
    channels = {TORQUE: inertia * jerk * time_s + drag, ANGLE: angle}
    phases = [each for block in blocks_of(SampleFrame(time_s, channels)) for each in block.phases]
    assert len(phases) > 15
    for phase in phases:
        motion_nm = inertia * phase.acceleration_rad_s2
        assert phase.torque_nm - motion_nm == pytest.approx(drag, abs=1e-9)


def told(frames: list[SampleFrame], gathering: Gathering | None) -> list[list[str]]:
    downsampler = Downsampler(DownsampleSettings(), RATIO)
    after = []
    for frame in frames:
        ready = [frame] if gathering is None else gathering.add(frame, downsampler.due_s)
        after.append([repr(block) for each in ready for block in downsampler.push(each)])
    return after


def cut(places: list[int]) -> list[SampleFrame]:
    edges = [0, *sorted(set(places)), 2000]
    return [frame_of(trace(), slice(start, end)) for start, end in pairwise(edges)]


@given(cuts)
@settings(max_examples=20, deadline=None)
def test_every_block_comes_with_the_frame_that_completes_it(places: list[int]) -> None:
    frames = cut(places)
    assert told(frames, Gathering()) == told(frames, None)


@given(cuts, st.lists(st.integers(0, 1999), max_size=3), st.integers(1, 300), st.booleans())
@settings(max_examples=40, deadline=None)
def test_faults_of_the_rows_are_told_alike(
    places: list[int], starts: list[int], rows: int, backwards: bool
) -> None:
    """Rows without torque, a gap, and a clock that begins anew."""
    columns = trace()
    for start in starts:
        columns[TORQUE][start : start + rows] = np.nan
    columns["time_s"][1500:] += -50.0 if backwards else 0.3
    edges = [0, *sorted(set(places)), 2000]
    frames = [frame_of(columns, slice(start, end)) for start, end in pairwise(edges)]
    with_wait = [block for blocks in told(frames, Gathering()) for block in blocks]
    without = [block for blocks in told(frames, None) for block in blocks]
    assert with_wait == without[: len(with_wait)]
    assert len(without) - len(with_wait) <= 1  # the last one may wait for its next frame


def test_frames_that_complete_nothing_are_bounded() -> None:
    gathering = Gathering()
    frames = [SampleFrame(np.array([float(k)]), {}) for k in range(3 * MOST_FRAMES)]
    ready = [each for frame in frames for each in gathering.add(frame, np.inf)]
    assert [len(each) for each in ready] == 3 * [MOST_FRAMES]


def test_a_frame_whose_clock_went_back_waits_for_nothing() -> None:
    gathering, (before, after) = Gathering(), cut([1000])
    assert (gathering.add(after, 0.0), gathering.add(before, 60.0)) == ([after], [before])
