"""From the true states of the axis to what a recorder writes down."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


@dataclass(slots=True)
class Sensors:
    """Noise and manners of the recorder; shares are per row."""

    linear_noise_m: float = 5e-8
    rotary_noise_rad: float = 5e-6
    torque_noise_nm: float = 0.02
    linear_quantum_m: float = 1e-8
    rotary_quantum_rad: float = 2 * np.pi / 2**21
    speed_lag_s: float = 5e-4
    skew_s: float = 0.0  # the linear encoder is read this much later
    dropped: float = 0.0
    repeated: float = 0.0
    missing: float = 0.0
    stuck: int = 0  # spans of 50 to 400 rows in which one channel stands
    clock_jumps: int = 0


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


def spoiled(columns: dict[str, Array], sensors: Sensors, seed: int) -> dict[str, Array]:
    """The recorder's bad manners: stuck spans, holes, missing and repeated rows, clock jumps."""
    rng = np.random.default_rng([seed, 13])
    n = len(columns["time_s"])
    columns = {name: column.copy() for name, column in columns.items()}
    signals = [name for name in columns if name not in ("time_s", "position_setpoint_m")]
    for _ in range(sensors.stuck):
        begin, name = int(rng.integers(0, n - 500)), str(rng.choice(signals))
        columns[name][begin : begin + int(rng.integers(50, 400))] = columns[name][begin]
    for name in signals:
        columns[name][rng.random(n) < sensors.missing] = np.nan
    for _ in range(sensors.clock_jumps):
        columns["time_s"][int(rng.integers(n // 10, n)) :] += rng.uniform(0.05, 1.0)
    times = np.where(rng.random(n) < sensors.dropped, 0, 1)
    times = np.where((times == 1) & (rng.random(n) < sensors.repeated), 2, times)
    rows = np.repeat(np.arange(n), times)
    return {name: column[rows] for name, column in columns.items()}
