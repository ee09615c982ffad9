import math

import numpy as np
import pytest

from edge_service.models.plant.controller import command_torque, gains_for

INERTIA, RATIO, LIMIT_NM = 1.5e-3, 0.02 / (2.0 * math.pi), 16.0
GAINS = gains_for(INERTIA, RATIO, LIMIT_NM, 1e-3)


def test_speed_loop_crosses_over_at_its_bandwidth_with_margin() -> None:
    omega = np.geomspace(1.0, 3000.0, 20_000)
    s = 1j * omega
    pi = GAINS.speed_gain_nm_s_per_rad + GAINS.integral_gain_nm_per_rad / s
    lag = np.exp(-s * GAINS.period_s / 2.0) / (1.0 + s * 5e-4)
    loop = np.asarray(pi * lag / (INERTIA * s))
    crossover = np.flatnonzero(np.abs(loop) < 1.0)[0]
    assert omega[crossover] == pytest.approx(2.0 * math.pi * 60.0, rel=0.1)
    assert 180.0 + np.degrees(np.angle(loop[crossover])) > 50.0


def test_acceleration_is_fed_forward_through_the_inertia() -> None:
    torque, _ = command_torque(GAINS, np.array([0.3, 0.0, 4.0]), 0.3, 0.0, 0.0)
    assert torque == pytest.approx(INERTIA * 4.0 / RATIO)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torque_is_limited_and_the_integral_does_not_wind_up(sign: float) -> None:
    setpoint = np.array([0.3 + sign, 0.0, 0.0])
    integral = 0.0
    for _ in range(1000):
        torque, integral = command_torque(GAINS, setpoint, 0.3, 0.0, integral)
        assert torque == sign * LIMIT_NM
    assert abs(integral) < LIMIT_NM
    overshoot_m = setpoint[0] + sign * 1e-4
    _, unwound = command_torque(GAINS, setpoint, overshoot_m, 0.0, sign * 5.0)
    assert abs(unwound) < 5.0
