"""The drive's cascade: position P, speed PI, speed and torque feed-forward, torque limit."""

import math
from typing import NamedTuple

from ...messages.samples import Floats
from ..compiled import compiled

SPEED_BANDWIDTH_HZ = 60.0
"""Crossover of the speed loop; about 55 degrees of phase margin with 1 ms of hold and filter."""
MAX_TORQUE_NM = 16.0
"""Torque limit where none is known: the thesis' motor at standstill (Table A.4)."""
LOOP_RATIO = 4.0
"""Speed loop over integral action, and over the position loop: each a quarter as fast."""


class Gains(NamedTuple):
    position_gain_per_s: float
    speed_gain_nm_s_per_rad: float
    integral_gain_nm_per_rad: float
    inertia_kg_m2: float  # that the torque feed-forward assumes
    ratio_m_per_rad: float
    max_torque_nm: float
    period_s: float  # from one command to the next


def gains_for(
    inertia_kg_m2: float,
    ratio_m_per_rad: float,
    max_torque_nm: float,
    period_s: float,
    bandwidth_hz: float = SPEED_BANDWIDTH_HZ,
) -> Gains:
    """Gains from the inertia and the bandwidth w of the speed loop.

    K_p = J w, T_n = 4 / w, K_v = w / 4: the loop J s omega = K_p (1 + 1 / (T_n s)) (w_ref - omega)
    crosses over near w, and the slower parts stay out of its way.
    """
    bandwidth_rad_s = 2.0 * math.pi * bandwidth_hz
    speed_gain = inertia_kg_m2 * bandwidth_rad_s
    return Gains(
        position_gain_per_s=bandwidth_rad_s / LOOP_RATIO,
        speed_gain_nm_s_per_rad=speed_gain,
        integral_gain_nm_per_rad=speed_gain * bandwidth_rad_s / LOOP_RATIO,
        inertia_kg_m2=inertia_kg_m2,
        ratio_m_per_rad=ratio_m_per_rad,
        max_torque_nm=max_torque_nm,
        period_s=period_s,
    )


@compiled
def command_torque(
    gains: Gains, setpoint: Floats, position_m: float, speed_rad_s: float, integral_nm: float
) -> tuple[float, float]:
    """Torque command, N m, and the integral part for the next period, N m.

    `setpoint` is position m, speed m/s, acceleration m/s^2, shape (3,). Friction is not fed
    forward. Anti-windup: at the torque limit the integral part only moves back from it.
    """
    position_error_m = setpoint[0] - position_m
    speed_command_m_s = setpoint[1] + gains.position_gain_per_s * position_error_m
    speed_error = speed_command_m_s / gains.ratio_m_per_rad - speed_rad_s
    wanted_nm = (
        gains.inertia_kg_m2 * setpoint[2] / gains.ratio_m_per_rad
        + gains.speed_gain_nm_s_per_rad * speed_error
        + integral_nm
    )
    torque_nm = min(max(wanted_nm, -gains.max_torque_nm), gains.max_torque_nm)
    if (wanted_nm - torque_nm) * speed_error <= 0.0:
        integral_nm += gains.integral_gain_nm_per_rad * gains.period_s * speed_error
    return torque_nm, integral_nm
