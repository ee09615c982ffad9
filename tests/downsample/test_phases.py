"""Phases of steady motion: exact means, the same for any chunks and any interval."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.downsample.statistics import GATE_S
from edge_service.messages.features import PHASES, FeatureBlock, Phase
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame

RATIO = 0.02 / (2.0 * np.pi)
INERTIA = 1.5e-3
DRAG = 0.3


def blocks_of(
    columns: dict[str, Floats], interval_s: float = 0.1, cuts: Sequence[int] = ()
) -> list[FeatureBlock]:
    downsampler = Downsampler(DownsampleSettings(interval_s=interval_s), RATIO)
    edges = [0, *sorted(set(cuts)), len(columns["time_s"])]
    blocks = []
    for start, end in itertools.pairwise(edges):
        channels = {k: v[start:end] for k, v in columns.items() if k != "time_s"}
        blocks += downsampler.push(SampleFrame(columns["time_s"][start:end], channels))
    return blocks


def pushed(time_s: Floats, net_nm: Floats, speed: float, drag: float = DRAG) -> dict[str, Floats]:
    """J w' = u - d in one direction, integrated exactly with u held from row to row."""
    step = np.diff(time_s)
    accel = net_nm[:-1] / INERTIA
    speeds = speed + np.concatenate([[0.0], np.cumsum(accel * step)])
    moved = speeds[:-1] * step + 0.5 * accel * step**2
    angle = np.concatenate([[0.0], np.cumsum(moved)])
    direction = np.sign(speed)
    return {"time_s": time_s, TORQUE: net_nm + direction * drag, ANGLE: angle}


def swing(seconds: float = 3.0) -> dict[str, Floats]:
    """To and fro with all phases, 1 kHz, noise on every channel."""
    rng = np.random.default_rng(4)
    time_s = np.arange(round(seconds * 1e3)) / 1e3
    angle = 60.0 * np.sin(2.0 * time_s)
    noise = rng.standard_normal((2, len(time_s)))
    return {
        "time_s": time_s,
        TORQUE: np.cos(2.0 * time_s) + 0.02 * noise[0],
        ANGLE: angle,
        TABLE_POSITION: 0.4 + RATIO * angle + 1e-7 * noise[1],
    }


def phases_of(blocks: Sequence[FeatureBlock]) -> list[Phase]:
    return [phase for block in blocks for phase in block.phases]


@pytest.mark.parametrize("uneven", [0.0, 0.15])
@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("interval_s", [0.01, 0.1])
def test_torque_less_inertia_torque_is_the_drag_exactly(
    interval_s: float, direction: float, uneven: float
) -> None:
    rng = np.random.default_rng(1)
    time_s = (np.arange(600) + uneven * rng.uniform(-1.0, 1.0, 600)) * 1e-3
    net = 0.3 * np.sin(np.arange(600) / 40.0) + 0.05 * rng.standard_normal(600)
    blocks = blocks_of(pushed(time_s, direction * net, direction * 80.0), interval_s)
    phases = phases_of(blocks)
    assert len(phases) > 6
    assert {block.steady_direction for block in blocks if block.phases} == {direction}
    for phase in phases:
        balance = phase.torque_nm - INERTIA * phase.acceleration_rad_s2
        assert balance == pytest.approx(direction * DRAG, abs=1e-8)


def test_stamps_that_scatter_are_not_taken_for_motion() -> None:
    """Samples on an even clock whose stamps are 20 us early or late."""
    true = swing() | {"time_s": 0.0505 + swing()["time_s"]}
    late_s = 2e-5 * np.random.default_rng(5).standard_normal(len(true["time_s"]))
    blocks = blocks_of(true | {"time_s": true["time_s"] + late_s})
    cut = blocks_of(true | {"time_s": true["time_s"] + late_s}, cuts=[1, 20, 415, 416, 1800])
    assert repr(cut) == repr(blocks)
    pairs = [(a.phases, b.phases) for a, b in zip(blocks_of(true), blocks, strict=True)][6:]
    alike = [zip(a, b, strict=True) for a, b in pairs if len(a) == len(b)]
    assert len(alike) > 20
    for known, found in itertools.chain.from_iterable(alike):
        assert found.acceleration_rad_s2 == pytest.approx(known.acceleration_rad_s2, abs=5.0)


@pytest.mark.parametrize("frequency_hz", [20.0, 60.0, 90.0])
def test_a_table_that_lags_is_seen_to_lag_alike_however_fast_it_swings(frequency_hz: float) -> None:
    """It lags by 1e-8 m per rad/s^2; what is averaged away of the one goes from the other, too."""
    turn, time_s = 2.0 * np.pi * frequency_hz, np.arange(3_000) / 1e3
    motion = 400.0 * np.sin(turn * time_s)
    angle = 40.0 * time_s - motion / turn**2
    table = 0.4 + RATIO * angle - 1e-8 * motion
    columns = {"time_s": time_s, TORQUE: np.zeros(3_000), ANGLE: angle, TABLE_POSITION: table}
    compared = 0
    for block in blocks_of(columns)[3:]:
        for phase in (block.accelerating, block.braking):
            if phase.steady_s:
                lag = 0.4 + RATIO * phase.angle_rad - phase.table_m
                expected = 1e-8 * phase.acceleration_rad_s2
                assert lag == pytest.approx(expected, rel=0.06)
                compared += 1
    assert compared > 20


@pytest.mark.parametrize("part", PHASES)
def test_short_intervals_sum_to_long_ones(part: str) -> None:
    """Wherever the axis does not turn round within a long interval."""
    columns = swing()
    short, compared = blocks_of(columns, 0.01), 0
    for long in blocks_of(columns, 0.1):
        inside = [b for b in short if long.time_s - 0.1 < b.time_s - 0.005 < long.time_s]
        directions = {b.steady_direction for b in inside} - {0.0}
        phase: Phase = getattr(long, part)
        if directions != {long.steady_direction} or not phase.steady_s:
            continue
        phases = [p for p in (getattr(b, part) for b in inside) if p.steady_s]
        weight = np.array([p.steady_s for p in phases])
        assert weight.sum() == pytest.approx(phase.steady_s, rel=1e-9)
        for name in ("torque_nm", "acceleration_rad_s2", "speed_rad_s", "angle_rad", "table_m"):
            values = np.array([getattr(p, name) for p in phases])
            mean = float(weight @ values / weight.sum())
            assert mean == pytest.approx(getattr(phase, name), rel=1e-9, abs=1e-9)
        compared += 1
    assert compared >= 3


def test_phases_follow_the_sign_of_the_acceleration_along_the_motion() -> None:
    for block in blocks_of(swing()):
        s = block.steady_direction
        limit = DownsampleSettings().cruise_rad_s2
        if block.accelerating.steady_s:
            assert s * block.accelerating.acceleration_rad_s2 > limit
        if block.braking.steady_s:
            assert s * block.braking.acceleration_rad_s2 < -limit
        for phase in block.phases:
            assert s * phase.speed_rad_s >= DownsampleSettings().min_speed_rad_s


def test_a_start_is_left_out_for_as_long_as_the_gate() -> None:
    """Rest until 0.5 s, then 50 rad/s at once: all rows from the gate on are steady."""
    time_s = np.arange(1100) / 1e3
    columns = {
        "time_s": time_s,
        TORQUE: np.full(1100, 0.3),
        ANGLE: 50.0 * np.maximum(time_s - 0.5, 0.0),
    }
    blocks = blocks_of(columns)
    assert all(not block.phases for block in blocks if block.time_s < 0.51)
    first = next(block for block in blocks if block.phases)
    assert first.time_s == pytest.approx(0.6)
    left_out_s = first.time_s - 0.5 - sum(phase.steady_s for phase in first.phases)
    window_s = 5e-3  # half width of the acceleration's window, which must lie behind the gate
    assert GATE_S - 2 * window_s <= left_out_s <= GATE_S + 2 * window_s


def test_an_interval_that_turns_round_tells_of_one_direction_only() -> None:
    time_s = np.arange(2000) / 1e3
    angle = 50.0 * np.abs(((time_s + 0.03) % 0.4) - 0.2)  # turns inside intervals
    blocks = blocks_of({"time_s": time_s, TORQUE: np.full(2000, 0.3), ANGLE: angle})
    turning = [b for b in blocks if b.reversal_count and b.phases]
    assert turning
    for block in turning:
        signs = {np.sign(phase.speed_rad_s) for phase in block.phases}
        assert signs == {block.steady_direction}
