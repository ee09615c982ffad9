import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_service.models.machine import Machine
from edge_service.models.motions import registry as motions

MOVES = st.builds(
    motions.Move,
    distance_m=st.floats(1e-6, 2.0) | st.floats(-2.0, -1e-6),
    speed_m_s=st.floats(1e-3, 2.0),
    acceleration_m_s2=st.floats(0.1, 20.0),
    jerk_m_s3=st.floats(1.0, 2000.0),
)
LIMITS = motions.MotionLimits(0.04, 0.76)


@given(MOVES)
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_move_ends_where_it_should_keeps_its_limits_and_is_the_integral_of_its_speed(
    move: motions.Move,
) -> None:
    time_s = np.linspace(0.0, move.duration_s, 1001)
    travel, speed, acceleration = move.setpoints(time_s).T
    assert (travel[0], speed[0], acceleration[0]) == (0.0, 0.0, 0.0)
    assert (travel[-1], speed[-1], acceleration[-1]) == (move.distance_m, 0.0, 0.0)
    slack = 1.0 + 1e-9
    assert np.max(np.abs(speed)) <= move.speed_m_s * slack
    assert np.max(np.abs(acceleration)) <= move.acceleration_m_s2 * slack
    h = time_s[1]
    assert np.max(np.abs(np.diff(acceleration))) <= move.jerk_m_s3 * h * (1.0 + 1e-6)
    assert np.all(np.diff(travel * np.sign(move.distance_m)) >= -1e-12)
    speed_error = np.diff(speed) - h * 0.5 * (acceleration[1:] + acceleration[:-1])
    travel_error = np.diff(travel) - h * 0.5 * (speed[1:] + speed[:-1])
    assert np.max(np.abs(speed_error)) <= 0.25 * move.jerk_m_s3 * h**2 + 1e-12
    assert np.max(np.abs(travel_error)) <= move.jerk_m_s3 * h**3 / 12.0 + 1e-12


def test_duration_is_the_closed_form_where_all_limits_are_reached() -> None:
    move = motions.Move(0.5, 0.4, 4.0, 200.0)
    assert move.duration_s == pytest.approx(0.5 / 0.4 + 0.4 / 4.0 + 4.0 / 200.0)
    peaks = np.max(np.abs(move.setpoints(np.linspace(0.0, move.duration_s, 10_001))), axis=0)
    assert peaks[1:] == pytest.approx([0.4, 4.0], rel=1e-6)
    assert (move.peak_speed_m_s, move.peak_acceleration_m_s2) == pytest.approx((0.4, 4.0))


def test_duration_of_a_short_step_is_four_jerk_phases() -> None:
    move = motions.Move(1e-4, 0.4, 4.0, 200.0)
    assert move.duration_s == pytest.approx(4.0 * (1e-4 / 400.0) ** (1.0 / 3.0))


def test_a_middle_distance_reaches_the_acceleration_but_not_the_speed() -> None:
    move = motions.Move(0.02, 2.0, 4.0, 200.0)
    peaks = np.max(move.setpoints(np.linspace(0.0, move.duration_s, 10_001)), axis=0)
    assert peaks[2] == pytest.approx(4.0, rel=1e-6)
    assert peaks[1] < 2.0
    assert peaks[1] == pytest.approx(0.02 / (move.duration_s / 2.0), rel=1e-3)


def take_production(seed: int, parts: list[int]) -> np.ndarray:
    segments = motions.MOTIONS["production"](LIMITS, np.random.default_rng(seed))
    source = motions.Setpoints(segments, LIMITS.low_m, 1000.0)
    return np.concatenate([source.take(n) for n in parts])


@given(st.lists(st.integers(0, 700), min_size=1, max_size=12))
def test_setpoints_do_not_depend_on_how_they_are_asked_for(parts: list[int]) -> None:
    whole = take_production(3, [sum(parts)])
    assert take_production(3, parts).tobytes() == whole.tobytes()


@pytest.mark.parametrize("seed", range(5))
def test_production_stays_inside_its_limits_and_is_continuous(seed: int) -> None:
    position, speed, acceleration = take_production(seed, [120_000]).T
    assert LIMITS.low_m - 1e-12 <= position.min() < 0.2
    assert 0.6 < position.max() <= LIMITS.high_m + 1e-12
    assert np.max(np.abs(speed)) <= LIMITS.rapid_m_s * (1.0 + 1e-9)
    assert np.max(np.abs(acceleration)) <= LIMITS.acceleration_m_s2 * (1.0 + 1e-9)
    assert np.max(np.abs(np.diff(acceleration))) <= LIMITS.jerk_m_s3 * 1e-3 * (1.0 + 1e-6)
    assert np.max(np.abs(np.diff(position) - 0.5e-3 * (speed[1:] + speed[:-1]))) < 1e-6


def test_limits_follow_the_machine_file(machine: Machine) -> None:
    limits = motions.motion_limits(machine)
    assert (limits.low_m, limits.high_m) == pytest.approx((0.04, 0.76))
    assert limits.speed_m_s == pytest.approx(2.0, rel=1e-3)  # 6000 rpm of Table A.4, lead 20 mm
    assert (limits.rapid_m_s, limits.acceleration_m_s2) == (0.5, 4.0)
    assert (limits.lead_m, limits.torque_nm) == (0.02, 16.0)
    slow = {"max_speed_rad_s": 50.0, "max_acceleration_m_s2": 1.0, "stroke_m": 0.4}
    axis = machine.axis.model_copy(update=slow)
    limits = motions.motion_limits(machine.model_copy(update={"axis": axis}))
    assert (limits.high_m, limits.speed_m_s) == pytest.approx((0.38, 50.0 * 0.02 / (2.0 * math.pi)))
    assert (limits.rapid_m_s, limits.acceleration_m_s2) == (limits.speed_m_s, 1.0)


def test_a_weak_motor_accelerates_with_half_of_its_torque(machine: Machine) -> None:
    axis = machine.axis.model_copy(update={"max_torque_nm": 1.0})
    limits = motions.motion_limits(machine.model_copy(update={"axis": axis}))
    ratio = 0.02 / (2.0 * math.pi)
    torque_nm = 1.5e-3 * limits.acceleration_m_s2 / ratio
    assert torque_nm == pytest.approx(0.5)
    friction_nm = 0.146 + 5e-3 * limits.rapid_m_s / ratio
    assert friction_nm == pytest.approx(0.5)


def test_a_motor_that_friction_holds_fast_is_refused(machine: Machine) -> None:
    axis = machine.axis.model_copy(update={"max_torque_nm": 0.25})
    with pytest.raises(
        motions.MotionError, match=r"axis\.max_torque_nm: 0\.25 N m against .* 0\.146 N m"
    ):
        motions.motion_limits(machine.model_copy(update={"axis": axis}))
