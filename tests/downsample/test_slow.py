"""Slow samples, as from OPC UA or Modbus: what they do not allow is said, not made up."""

import numpy as np
import pytest

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.samples import (
    ANGLE,
    TABLE_POSITION,
    TORQUE,
    Floats,
    Quality,
    SampleFrame,
)

RATIO_M_PER_RAD = 0.02 / (2.0 * np.pi)
SPEED_RAD_S = 20.0
TORQUE_NM = 0.15


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
