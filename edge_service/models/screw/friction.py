"""Stribeck friction in the exponential form (Armstrong-Helouvry, 1991)."""

from typing import TypeVar

import numpy as np

from ...messages.samples import Floats

Number = TypeVar("Number", float, Floats)
"""One number, or an array of any shape."""


def stribeck_decay(speed: Number, stribeck_speed: float, exponent: float = 1.0) -> Number:
    """Share of the Stribeck excess that is left at a speed: exp(-|v / v_st|^delta).

    In the shape of `speed`. Not in the thesis; delta is 1 or 2 in most of the literature
    (Armstrong-Helouvry, 1991). Compiled code takes it `inlined`.

    >>> round(float(stribeck_decay(2.0, 2.0)), 6)
    0.367879
    """
    share: Number = np.exp(-(np.abs(speed / stribeck_speed) ** exponent))
    return share


def exponential_friction(
    speed_m_s: Floats | float,
    coulomb_n: float,
    breakaway_n: float,
    stribeck_speed_m_s: float,
    viscous_n_s_per_m: float = 0.0,
) -> Floats:
    """Friction in the exponential form of the simulated axis, N, in the shape of `speed_m_s`.

    sgn(v) (F_c + (F_brk - F_c) exp(-(v / v_st)^2)) + D v

    Not in the thesis, but common in the literature (Armstrong-Helouvry, 1991). It jumps at rest
    from -F_brk to F_brk; (5.3.13) peaks at v_st / sqrt(2) and has the longer tail: constants fitted
    with one form may not be used in the other. Torques at the motor: times R_t, the speed over R_t.

    >>> round(float(exponential_friction(1e-9, 60.0, 90.0, 0.01)), 6)
    90.0
    """
    speed_m_s = np.asarray(speed_m_s)
    excess_n = (breakaway_n - coulomb_n) * stribeck_decay(speed_m_s, stribeck_speed_m_s, 2.0)
    level = coulomb_n + excess_n
    return np.sign(speed_m_s) * level + viscous_n_s_per_m * speed_m_s
