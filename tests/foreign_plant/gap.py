"""The gap between a recording and the bare baseline, to see what a cause does."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from .machine import Machine
from .simulate import Recording


def gap(recording: Recording, machine: Machine) -> dict[str, float]:
    """Of torque in motion, N m, and of the transmission, m; evenly sampled only."""
    low = butter(3, 40.0, fs=1000.0, output="sos")
    columns = recording.columns
    angle = sosfiltfilt(low, columns["motor_angle_rad"] - columns["motor_angle_rad"][0])
    speed = np.gradient(angle, 1e-3)
    need = machine.inertia_kg_m2 * np.gradient(speed, 1e-3) + machine.viscous_nm_s_per_rad * speed
    raw = np.gradient(sosfiltfilt(low, columns["position_setpoint_m"]), 1e-3) / machine.lead_rad
    need = need + sosfiltfilt(
        low, machine.coulomb_nm * np.sign(np.where(abs(raw) > 0.05, raw, 0.0))
    )
    torque = need - sosfiltfilt(low, columns["torque_command_nm"])
    stretch = machine.lead_rad * columns["motor_angle_rad"] - columns["table_position_m"]
    stretch, moving = stretch - stretch.mean(), abs(raw) > 0.3
    return {
        "torque_nm": float(np.sqrt(np.mean(torque[moving] ** 2))),
        "transmission_m": float(np.std(sosfiltfilt(low, stretch))),
    }
