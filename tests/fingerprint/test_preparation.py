"""Recordings with faults become runs whose motion is that of the formula."""

import math

import numpy as np
import pytest
from scipy import signal

from edge_service.messages.samples import (
    ANGLE,
    SETPOINT,
    TABLE_POSITION,
    TORQUE,
    Floats,
    SampleFrame,
)
from edge_service.recordings.conditioning import uniform_runs, white_noise_rms
from edge_service.regression.prepared_run import (
    DECIMATION,
    PreparationSettings,
    derivative_noise_rms,
    prepare,
)

RATIO = 0.02 / (2.0 * math.pi)
HZ = 3.0


def sine(time_s: Floats) -> SampleFrame:
    """Angle of 10 rad amplitude at 3 Hz, torque in phase with it."""
    phase = 2.0 * math.pi * HZ * time_s
    return SampleFrame(time_s, {ANGLE: 10.0 * np.sin(phase), TORQUE: 2.0 * np.sin(phase)})


def even(seconds: float) -> Floats:
    return np.arange(round(1000.0 * seconds)) / 1000.0


def test_repeats_and_rows_out_of_order_are_dropped() -> None:
    time_s = even(1.0)
    order = np.concatenate((np.arange(400), [399, 399, 395], np.arange(400, 1000)))
    (run,) = uniform_runs(sine(time_s[order]), (ANGLE,))
    np.testing.assert_allclose(run.time_s, time_s, atol=1e-9)
    np.testing.assert_array_equal(run.channels[ANGLE], sine(time_s).channels[ANGLE])


def test_lost_rows_are_bridged_gaps_and_new_clocks_are_not() -> None:
    time_s = np.delete(even(4.0), [500, 900, 901])
    (run,) = uniform_runs(sine(time_s), (ANGLE,))
    assert len(run) == 4000
    np.testing.assert_allclose(run.channels[ANGLE], sine(even(4.0)).channels[ANGLE], atol=1e-6)
    for gap_s in (0.01, 0.5):
        jumped = np.where(even(4.0) >= 2.0, even(4.0) + gap_s, even(4.0))
        assert [len(run) for run in uniform_runs(sine(jumped), (ANGLE,))] == [2000, 2000]
    restarted = np.concatenate((even(2.0), even(1.0)))
    assert [len(run) for run in uniform_runs(sine(restarted), (ANGLE,))] == [2000, 1000]


def test_a_missing_required_value_is_a_lost_row_and_an_optional_one_costs_the_channel() -> None:
    frame = sine(even(1.0))
    torque, table = frame.channels[TORQUE].copy(), RATIO * frame.channels[ANGLE]
    torque[300:303], table[10] = np.nan, np.nan
    holed = SampleFrame(frame.time_s, {**frame.channels, TORQUE: torque, TABLE_POSITION: table})
    (run,) = uniform_runs(holed, (ANGLE, TORQUE), optional=(TABLE_POSITION,))
    assert set(run.channels) == {ANGLE, TORQUE}
    np.testing.assert_allclose(run.channels[TORQUE], frame.channels[TORQUE], atol=1e-6)


def test_motion_is_that_of_the_formula() -> None:
    (run,) = prepare(sine(even(4.0)), PreparationSettings(RATIO, edge_s=0.2))
    turning = 2.0 * math.pi * HZ
    phase = turning * run.time_s
    np.testing.assert_allclose(run.channels[ANGLE], 10.0 * np.sin(phase), atol=1e-3)
    np.testing.assert_allclose(run.speed_rad_s, 10.0 * turning * np.cos(phase), atol=0.03)
    expected = -10.0 * turning**2 * np.sin(phase)
    np.testing.assert_allclose(run.acceleration_rad_s2, expected, atol=1.0)


def test_standstill_and_its_surroundings_are_masked() -> None:
    time_s = even(3.0)
    angle = np.where(time_s < 1.0, 0.0, 20.0 * (time_s - 1.0))
    frame = SampleFrame(time_s, {ANGLE: angle, TORQUE: 0.1 * np.sin(time_s)})
    (run,) = prepare(frame, PreparationSettings(RATIO))
    assert not run.moving[run.time_s < 1.0].any()
    assert run.moving[run.time_s > 1.1].all()


def test_white_noise_is_seen_beneath_the_motion_and_carried_through_the_filters() -> None:
    random = np.random.default_rng(4)
    clean = sine(even(20.0))
    noise = 1e-3 * random.standard_normal(20_000)
    noisy = SampleFrame(clean.time_s, {**clean.channels, ANGLE: clean.channels[ANGLE] + noise})
    assert white_noise_rms(noisy.channels[ANGLE]) == pytest.approx(1e-3, rel=0.05)
    settings = PreparationSettings(RATIO)
    (plain,), (run,) = prepare(clean, settings), prepare(noisy, settings)
    for times, name in ((1, "speed_rad_s"), (2, "acceleration_rad_s2")):
        noise = getattr(run, name) - getattr(plain, name)
        left = signal.decimate(noise, DECIMATION, zero_phase=True)
        assert derivative_noise_rms(run, ANGLE, times) == pytest.approx(np.std(left), rel=0.1)


def test_a_stuck_channel_parts_the_recording_while_the_axis_moves() -> None:
    """A third of a second of one torque, and of one angle; at rest a repeat is none."""
    frame = sine(even(6.0))
    stuck = {name: values.copy() for name, values in frame.channels.items()}
    stuck[TABLE_POSITION] = RATIO * frame.channels[ANGLE]
    stuck[TORQUE][2000:2300] = stuck[TORQUE][2000]
    stuck[ANGLE][4000:4300] = stuck[ANGLE][4000]
    runs = list(uniform_runs(SampleFrame(frame.time_s, stuck), (ANGLE, TORQUE, TABLE_POSITION)))
    assert [len(run) for run in runs] == [2000, 1700, 1700]
    still = {ANGLE: np.zeros(2000), TORQUE: np.zeros(2000)}
    (run,) = uniform_runs(SampleFrame(even(2.0), still), (ANGLE, TORQUE))
    assert len(run) == 2000


def test_a_torque_at_its_limit_is_not_stuck_and_a_dead_encoder_is_no_channel() -> None:
    frame = sine(even(4.0))
    clipped = np.clip(frame.channels[TORQUE], -0.5, 0.5)
    dead = np.full(4000, 0.3)
    channels = {ANGLE: frame.channels[ANGLE], TORQUE: clipped, TABLE_POSITION: dead}
    (run,) = uniform_runs(
        SampleFrame(frame.time_s, channels), (ANGLE, TORQUE), optional=(TABLE_POSITION,)
    )
    assert len(run) == 4000
    assert set(run.channels) == {ANGLE, TORQUE}


def test_wild_values_are_missing_ones() -> None:
    frame = sine(even(1.0))
    frame.channels[TORQUE][500:502] = 1e300
    (run,) = uniform_runs(frame, (ANGLE, TORQUE))
    assert run.channels[TORQUE] == pytest.approx(sine(even(1.0)).channels[TORQUE], abs=1e-6)


def test_the_step_of_a_filter_leaves_no_rest_in_the_motion() -> None:
    """A torque that is wild at rest changes nothing of the rows that count."""
    time_s = even(4.0)
    angle = np.where(time_s < 2.0, 5.0 * np.sin(time_s), 5.0 * math.sin(2.0))
    torque = 0.3 + 0.01 * np.sin(40.0 * time_s)
    rest = np.where(time_s < 2.0, 0.0, 50.0 * np.sin(300.0 * time_s))
    rows = []
    for added in (0.0, 1.0):
        frame = SampleFrame(time_s, {ANGLE: angle, TORQUE: torque + added * rest})
        (run,) = prepare(frame, PreparationSettings(RATIO))
        rows.append(run.moving_rows(run.channels[TORQUE]))
    assert len(rows[0]) > 100
    np.testing.assert_allclose(rows[1], rows[0], atol=50.0 * math.exp(-5.0))
    np.testing.assert_allclose(rows[1][:-5], rows[0][:-5], atol=2e-3)


def test_bad_input_is_one_line() -> None:
    frame = sine(even(1.0))
    with pytest.raises(ValueError, match=f"the recording lacks {SETPOINT}.*it has {ANGLE}"):
        list(prepare(frame, PreparationSettings(RATIO), required=(SETPOINT,)))
    with pytest.raises(ValueError, match=r"cutoff_hz: 600 Hz is not below half .* 500 Hz"):
        list(prepare(frame, PreparationSettings(RATIO, cutoff_hz=600.0)))
    still = SampleFrame(np.zeros(100), {ANGLE: np.zeros(100)})
    with pytest.raises(ValueError, match="time_s never increases"):
        list(uniform_runs(still, (ANGLE,)))
