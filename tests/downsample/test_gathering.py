"""Frames that wait are none the worse for it: the same blocks, none of them later."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.downsample.rows import MOST_FRAMES, Gathering
from edge_service.messages.samples import TORQUE, SampleFrame

from .test_downsampler import RATIO, frame_of, trace

cuts = st.lists(st.integers(1, 1999), max_size=60)


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
    assert gathering.add(after, 0.0) == [after]
    assert gathering.add(before, 60.0) == [before]
