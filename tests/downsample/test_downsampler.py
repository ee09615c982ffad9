"""Intervals keep the physics exact, do not depend on chunking, and tell every data fault."""

import json
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.downsample.interval_kernels import lever
from edge_service.messages import samples
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.samples import Floats, SampleFrame

RATIO = 0.02 / (2.0 * np.pi)
RNG_SEED = 3


def trace(seconds: float = 2.0, rate_hz: float = 1000.0) -> dict[str, Floats]:
    """A swing to and fro with noise on the torque, all channels."""
    rng = np.random.default_rng(RNG_SEED)
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    theta = 40.0 * np.sin(1.5 * time_s)
    return {
        "time_s": time_s,
        samples.TORQUE: np.cos(1.5 * time_s) + 0.02 * rng.standard_normal(len(time_s)),
        samples.ANGLE: theta,
        samples.TABLE_POSITION: theta * RATIO + 1e-7 * rng.standard_normal(len(time_s)),
        samples.MOTOR_SPEED: 60.0 * np.cos(1.5 * time_s),
        samples.SETPOINT: theta * RATIO,
    }


def frame_of(columns: dict[str, Floats], rows: slice | Floats = slice(None)) -> SampleFrame:
    time_s = columns["time_s"][rows]
    return SampleFrame(time_s, {k: v[rows] for k, v in columns.items() if k != "time_s"})


def blocks_of(
    columns: dict[str, Floats], cuts: Sequence[int] = (), interval_s: float = 0.1
) -> list[FeatureBlock]:
    downsampler = Downsampler(DownsampleSettings(interval_s=interval_s), RATIO)
    edges = [0, *sorted(set(cuts)), len(columns["time_s"])]
    return [
        block
        for start, end in pairwise(edges)
        for block in downsampler.push(frame_of(columns, slice(start, end)))
    ]


def test_mean_and_lever_of_a_held_quantity() -> None:
    # q = 3 on [0, 1), 5 on [1, 4): mean 18/4; lever (int (4-s) q) / 16 = (10.5 + 22.5) / 16
    mean, arm = lever(np.array([3.0, 5.0]), np.array([0.0, 1.0, 4.0]))
    assert (mean, arm) == pytest.approx((4.5, 33.0 / 16.0), rel=1e-15)


@pytest.mark.parametrize("interval_s", [0.001, 0.007, 0.1, 0.3])
def test_the_balance_of_momentum_and_angle_is_exact_for_any_interval(interval_s: float) -> None:
    """J w' = u - d sgn(w), integrated exactly between samples with u held."""
    inertia, drag, step = 1.5e-3, 0.1, 1e-3
    torque = drag + 0.3 * np.cos(np.arange(400) / 60.0) ** 2 * np.random.default_rng(1).random(400)
    accel = (torque - drag) / inertia
    speed = 5.0 + np.concatenate([[0.0], np.cumsum(accel * step)])[:-1]
    theta = np.concatenate([[0.0], np.cumsum(speed * step + accel * step**2 / 2)])[:-1]
    columns = {"time_s": np.arange(400) * step, samples.TORQUE: torque, samples.ANGLE: theta}
    blocks = blocks_of(columns, interval_s=interval_s)
    assert blocks
    for block in blocks:
        duration, first = block.duration_s, round((block.time_s - block.duration_s) / step)
        last = round(block.time_s / step)
        gained = duration * (block.torque_mean_nm - drag * block.direction_mean) / inertia
        assert gained == pytest.approx(speed[last] - speed[first], rel=1e-9, abs=1e-9)
        path = duration**2 * (block.torque_lever_nm - drag * block.direction_lever) / inertia
        travelled = block.angle_end_rad - block.angle_start_rad
        assert speed[first] * duration + path == pytest.approx(travelled, rel=1e-9, abs=1e-12)


def test_speeds_at_the_ends_and_means_of_known_motion() -> None:
    time_s = np.arange(1000) * 1e-3
    theta = 3.0 * time_s**2
    blocks = blocks_of({"time_s": time_s, samples.TORQUE: np.sin(time_s), samples.ANGLE: theta})
    block = blocks[4]
    assert block.time_s == pytest.approx(0.5)
    assert block.speed_start_rad_s == pytest.approx(6.0 * 0.4, rel=1e-9)
    assert block.speed_end_rad_s == pytest.approx(6.0 * 0.5, rel=1e-9)
    assert block.angle_mean_rad == pytest.approx((0.5**3 - 0.4**3) / 0.1, rel=1e-5)
    assert block.direction_mean == 1.0
    assert block.direction_lever == pytest.approx(0.5)
    assert block.moving_fraction == 1.0


def test_blocks_fall_on_the_grid_and_cover_the_trace() -> None:
    blocks = blocks_of(trace(2.0))
    np.testing.assert_allclose([b.time_s for b in blocks], np.arange(1, 20) * 0.1, atol=1e-12)
    np.testing.assert_allclose([b.duration_s for b in blocks], 0.1, atol=1e-12)
    assert {b.sample_count for b in blocks} == {100}
    assert {b.fault for b in blocks} == {Fault.NONE}


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 1999), max_size=30), st.sampled_from([0.005, 0.013, 0.1]))
def test_blocks_do_not_depend_on_how_samples_are_parted(cuts: list[int], interval_s: float) -> None:
    columns = faulty_trace()
    whole = blocks_of(columns, interval_s=interval_s)
    assert repr(blocks_of(columns, cuts, interval_s)) == repr(whole)


def faulty_trace() -> dict[str, Floats]:
    """Two seconds with a repeat, a hole, a gap, rows out of order and missing values."""
    columns = trace(2.0)
    rows = np.r_[0:150, 149, 149, 150:350, 353:600, 590, 595, 600:900, 1200:2000]
    columns = {name: values[rows] for name, values in columns.items()}
    columns[samples.TORQUE][1000:1003] = np.nan
    return columns


def at(blocks: list[FeatureBlock], time_s: float) -> FeatureBlock:
    return min(blocks, key=lambda block: abs(block.time_s - time_s))


def test_faults_of_time_are_reported_where_they_are_and_nowhere_else() -> None:
    blocks = blocks_of(faulty_trace())
    assert at(blocks, 0.2).fault == Fault.REPEAT
    assert at(blocks, 0.2).usable
    assert at(blocks, 0.4).fault == Fault.HOLE
    assert at(blocks, 0.4).usable
    assert at(blocks, 0.6).fault == Fault.TIME_BACKWARDS
    assert not at(blocks, 0.6).usable
    assert at(blocks, 0.7).fault == Fault.TIME_BACKWARDS  # its speed at the start leans on it
    gap = [block for block in blocks if Fault.GAP in block.fault]
    assert [block.usable for block in gap] == [False]
    times_s = {block.time_s for block in blocks if block.fault}
    assert len(times_s) == 6  # the five above and the hole of missing values


def test_a_hole_is_bridged_and_a_longer_one_is_a_gap() -> None:
    columns = trace(1.0)
    for missing, fault in ((1, Fault.HOLE), (5, Fault.HOLE), (8, Fault.GAP)):
        rows = np.delete(np.arange(1000), np.arange(450, 450 + missing))
        blocks = blocks_of({name: values[rows] for name, values in columns.items()})
        assert {block.fault for block in blocks if block.fault} == {fault}


def test_a_clock_that_begins_anew_is_survived() -> None:
    columns = trace(4.0)
    restarted = columns | {
        "time_s": np.where(columns["time_s"] < 2.0, columns["time_s"] + 5.0, columns["time_s"] - 2)
    }
    blocks = blocks_of(restarted)
    late = [block for block in blocks if block.time_s < 2.0]
    assert len(late) >= 18
    assert all(block.usable for block in late)
    assert not [b for b in blocks if b.fault]  # a source that began anew is no fault of the data


def damaged(change: Callable[[dict[str, Floats]], None]) -> list[FeatureBlock]:
    columns = {name: values.copy() for name, values in trace(1.0).items()}
    change(columns)
    return blocks_of(columns)


@pytest.mark.parametrize("row", [398, 399, 400, 401, 402, 450])
def test_a_wild_value_spoils_no_good_interval_wherever_it_stands(row: int) -> None:
    def jump(columns: dict[str, Floats]) -> None:
        columns[samples.ANGLE][row] += 4.0

    clean, blocks = blocks_of(trace(1.0)), damaged(jump)
    for block, truth in zip(blocks, clean, strict=True):
        if block.usable:
            assert block.speed_start_rad_s == pytest.approx(truth.speed_start_rad_s, rel=1e-6)
            assert block.speed_end_rad_s == pytest.approx(truth.speed_end_rad_s, rel=1e-6)
            assert block.angle_mean_rad == pytest.approx(truth.angle_mean_rad, rel=1e-6)


@pytest.mark.parametrize(
    ("channel", "fault"), [(samples.TORQUE, Fault.NO_TORQUE), (samples.ANGLE, Fault.NO_POSITION)]
)
@pytest.mark.parametrize("cuts", [[], [250, 333, 420, 480, 555, 700]])
def test_rows_without_a_needed_value_are_reported_interval_by_interval(
    channel: str, fault: Fault, cuts: list[int]
) -> None:
    columns = {name: values.copy() for name, values in trace(1.0).items()}
    columns[channel][230:670] = np.nan
    blocks = blocks_of(columns, cuts)
    assert [b.time_s for b in blocks if fault in b.fault] == pytest.approx([0.4, 0.5, 0.6])
    assert repr(blocks) == repr(blocks_of(columns))
    assert [round(b.time_s, 1) for b in blocks if b.usable] == [0.1, 0.2, 0.7, 0.8, 0.9]


@pytest.mark.parametrize("channel", [samples.ANGLE, samples.TORQUE])
def test_a_stuck_channel_never_passes_as_good(channel: str) -> None:
    def stick(columns: dict[str, Floats]) -> None:
        columns[channel][400:620] = columns[channel][400]

    blocks = damaged(stick)
    assert Fault.STUCK in at(blocks, 0.5).fault
    assert Fault.STUCK in at(blocks, 0.6).fault
    assert at(blocks, 0.3).usable
    assert at(blocks, 0.9).usable


def test_an_axis_at_rest_is_not_stuck() -> None:
    time_s = np.arange(1000) * 1e-3
    still = np.full(1000, 2.0)
    blocks = blocks_of(
        {
            "time_s": time_s,
            samples.TORQUE: np.full(1000, 0.05),
            samples.ANGLE: still,
            samples.TABLE_POSITION: still * RATIO,
            samples.SETPOINT: still * RATIO,
        }
    )
    assert {block.fault for block in blocks} == {Fault.NONE}
    assert {block.moving_fraction for block in blocks} == {0.0}


def test_without_a_rotary_encoder_the_linear_one_stands_in() -> None:
    columns = trace(1.0)
    del columns[samples.ANGLE], columns[samples.MOTOR_SPEED]
    block = blocks_of(columns)[3]
    reference = blocks_of(trace(1.0))[3]
    assert block.angle_end_rad == pytest.approx(reference.angle_end_rad, abs=1e-3)
    assert block.fault == Fault.NONE
    assert np.isnan(block.table_mean_m)


def test_a_state_within_rows_that_lack_a_value_goes_on() -> None:
    columns = trace(1.0)
    columns[samples.TORQUE][-20] = np.nan
    one, other = (Downsampler(DownsampleSettings(interval_s=0.1), RATIO) for _ in range(2))
    one.push(frame_of(columns))
    kept = json.loads(json.dumps(one.snapshot(), allow_nan=False))
    assert kept["absent"]
    other.restore(kept)
    assert json.loads(json.dumps(other.snapshot())) == kept


def test_a_state_of_another_version_is_told_from_a_damaged_one() -> None:
    kept = Downsampler(DownsampleSettings(), RATIO).snapshot()
    with pytest.raises(ValueError, match=r"^no downsampler/6 snapshot$"):
        Downsampler(DownsampleSettings(), RATIO).restore({**kept, "schema": "downsampler/3"})


garbage = st.tuples(
    st.sampled_from(
        ["time_s", samples.TORQUE, samples.ANGLE, samples.TABLE_POSITION, samples.SETPOINT]
    ),
    st.integers(0, 599),
    st.floats(allow_nan=True, allow_infinity=True, width=64),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(garbage, max_size=20))
def test_garbage_never_gives_a_usable_number_that_is_not_finite(
    cells: list[tuple[str, int, float]],
) -> None:
    columns = trace(0.6)
    for channel, row, value in cells:
        columns[channel][row] = value
    for block in blocks_of(columns):
        numbers = [block.torque_mean_nm, block.torque_lever_nm, block.speed_end_rad_s]
        assert not block.usable or np.isfinite(numbers).all()
