"""From the true states of the axis to what a recorder writes down."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


@dataclass(slots=True)
class Sensors:
    """Noise and manners of the recorder."""

    linear_noise_m: float = 5e-8
    rotary_noise_rad: float = 5e-6
    torque_noise_nm: float = 0.02
    linear_quantum_m: float = 1e-8
    rotary_quantum_rad: float = 2 * np.pi / 2**21
    speed_lag_s: float = 5e-4
    skew_s: float = 0.0  # the linear encoder is read this much later


def hermite(value: Array, slope: Array, at: Array) -> Array:
    """Cubic through values and slopes on the 1 kHz grid, read at times `at` (s)."""
    u = np.clip(at / 1e-3, 0.0, len(value) - 1.000001)
    i = u.astype(int)
    u = u - i
    a, b = value[i], value[i + 1]
    da, db = 1e-3 * slope[i], 1e-3 * slope[i + 1]
    return a + u * (da + u * (3 * (b - a) - 2 * da - db + u * (2 * (a - b) + da + db)))


def lagged(signal: Array, lag_s: float) -> Array:
    """First-order lag on the 1 kHz grid."""
    keep = float(np.exp(-1e-3 / lag_s))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], signal, zi=[keep * signal[0]])[0])


def quantised(signal: Array, quantum: float) -> Array:
    return np.round(signal / quantum) * quantum if quantum > 0.0 else signal


def record(
    states: Array, setpoint_m: Array, temperature_c: Array, sensors: Sensors, seed: int
) -> dict[str, Array]:
    """States (n, 5) of the kernel -> columns, evenly sampled, all of them sound."""
    rng = np.random.default_rng([seed, 11])
    n = len(states)
    time_s = np.arange(n) * 1e-3
    angle, speed, x, v, torque = states.T
    if sensors.skew_s != 0.0:
        x = hermite(x, v, time_s + sensors.skew_s)
    rotary = rng.standard_normal(n) * sensors.rotary_noise_rad
    linear = rng.standard_normal(n) * sensors.linear_noise_m
    return {
        "time_s": time_s,
        "torque_command_nm": torque + rng.standard_normal(n) * sensors.torque_noise_nm,
        "motor_angle_rad": quantised(angle + rotary, sensors.rotary_quantum_rad),
        "motor_speed_rad_s": lagged(speed + np.gradient(rotary, 1e-3), sensors.speed_lag_s),
        "table_position_m": quantised(x + linear, sensors.linear_quantum_m),
        "table_speed_m_s": lagged(v + np.gradient(linear, 1e-3), sensors.speed_lag_s),
        "position_setpoint_m": setpoint_m,
        "temperature_c": np.round(temperature_c + rng.normal(0.0, 0.03, n), 1),
    }
