"""The gap between a recording and the bare baseline, to see what a cause does."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from .machine import Machine
from .simulate import Recording


def gap(recording: Recording, machine: Machine) -> dict[str, float]:
    """Of torque in motion, N m, and of the transmission, m; evenly sampled only."""
    low, smooth = (butter(4, hz, fs=1000.0, output="sos") for hz in (40.0, 100.0))
    columns = recording.columns
    angle = sosfiltfilt(smooth, columns["motor_angle_rad"] - columns["motor_angle_rad"][0])
    speed = np.gradient(angle, 1e-3)
    need = machine.inertia_kg_m2 * np.gradient(speed, 1e-3) + machine.viscous_nm_s_per_rad * speed
    need, moving = need + machine.coulomb_nm * np.sign(speed), np.abs(speed) > 0.1
    torque = sosfiltfilt(low, np.where(moving, columns["torque_command_nm"] - need, 0.0))
    stretch = columns["table_position_m"] - machine.lead_rad * columns["motor_angle_rad"]
    return {
        "torque_nm": float(np.sqrt(np.mean(torque[moving] ** 2))),
        "transmission_m": float(np.std(sosfiltfilt(low, stretch - stretch[0]))),
    }
