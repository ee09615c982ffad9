"""Friction of a sliding contact over its speed (thesis, 5.3.12-5.3.15).

The print is the smooth form that Simscape's translational friction has. What it implies:

* The Stribeck part (5.3.13) is zero at rest. With u = v / v_st it is u exp(-u^2) sqrt(2 e) times
  F_brk - F_c, whose maximum over u lies at u = 1 / sqrt(2) and is exactly F_brk - F_c: sqrt(2 e)
  is nothing but the factor that makes it so. The breakaway speed is v_st / sqrt(2).
* Nothing sticks: at rest the whole is f_offset, and any force below breakaway creeps at about that
  force over the slope at rest. The simulated axis, which must stick, has another form.
* (5.3.14) adds the offset to the Coulomb part, but an offset (gravity, tilt, torque bias) is no
  friction: it does not turn with the speed and can drive the axis. All else opposes the speed.
"""

import math
from dataclasses import dataclass

import numpy as np

from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_not_negative, require_positive

PEAK_FACTOR = math.sqrt(2.0 * math.e)
"""sqrt(2 e) of (5.3.13): one over the maximum of u exp(-u^2)."""


@dataclass(frozen=True, slots=True)
class Friction:
    """Stribeck, Coulomb and viscous friction of one contact (5.3.12).

    Attributes:
        coulomb_n: F_c, level at high speed without the viscous part, N.
        breakaway_n: F_brk, F_c plus the height of the Stribeck peak, N.
        stribeck_speed_m_s: v_st of (5.3.13), m/s.
        coulomb_speed_m_s: v_Coul of (5.3.14), m/s: the sign of the speed is rounded over it.
        viscous_n_s_per_m: D of (5.3.15), N s/m.
        offset_n: f_offset of (5.3.14), N.

    >>> contact = Friction(60.0, 90.0, 0.01, 1e-4, viscous_n_s_per_m=200.0)
    >>> round(float(contact.force_n(contact.breakaway_speed_m_s)), 3)  # 90 + 200 * 0.00707
    91.414
    >>> round(float(contact.slope_n_s_per_m(1.0)), 6)
    200.0
    """

    coulomb_n: float
    breakaway_n: float
    stribeck_speed_m_s: float
    coulomb_speed_m_s: float
    viscous_n_s_per_m: float = 0.0
    offset_n: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(
            coulomb_n=self.coulomb_n,
            viscous_n_s_per_m=self.viscous_n_s_per_m,
        )
        require_positive(
            stribeck_speed_m_s=self.stribeck_speed_m_s,
            coulomb_speed_m_s=self.coulomb_speed_m_s,
        )
        if not self.coulomb_n <= self.breakaway_n < math.inf:
            raise ValueError(
                f"breakaway_n must be finite and at least coulomb_n, got {self.breakaway_n:g} "
                f"and {self.coulomb_n:g}"
            )
        if not math.isfinite(self.offset_n):
            raise ValueError(f"offset_n must be finite, got {self.offset_n:g}")

    @property
    def breakaway_speed_m_s(self) -> float:
        """Speed of the Stribeck peak, m/s: v_st / sqrt(2), where (5.3.13) has its maximum."""
        return self.stribeck_speed_m_s / math.sqrt(2.0)

    def stribeck_n(self, speed_m_s: Floats | float) -> Floats:
        """Stribeck part, N: sqrt(2 e) (F_brk - F_c) exp(-(v / v_st)^2) v / v_st (5.3.13)."""
        share = np.asarray(speed_m_s) / self.stribeck_speed_m_s
        excess_n = self.breakaway_n - self.coulomb_n
        return PEAK_FACTOR * excess_n * np.exp(-(share**2)) * share

    def coulomb_part_n(self, speed_m_s: Floats | float) -> Floats:
        """Coulomb part with the offset, N: F_c tanh(v / v_Coul) + f_offset (5.3.14)."""
        rounded_sign = np.tanh(np.asarray(speed_m_s) / self.coulomb_speed_m_s)
        return self.coulomb_n * rounded_sign + self.offset_n

    def viscous_n(self, speed_m_s: Floats | float) -> Floats:
        """Viscous part, N: D v (5.3.15)."""
        return self.viscous_n_s_per_m * np.asarray(speed_m_s)

    def force_n(self, speed_m_s: Floats | float) -> Floats:
        """Friction force against positive speed, N, in the shape of `speed_m_s` (5.3.12)."""
        return (
            self.stribeck_n(speed_m_s) + self.coulomb_part_n(speed_m_s) + self.viscous_n(speed_m_s)
        )

    def slope_n_s_per_m(self, speed_m_s: Floats | float) -> Floats:
        """Derivative of (5.3.12) by the speed, N s/m, in the shape of `speed_m_s`.

        sqrt(2 e) (F_brk - F_c) / v_st (1 - 2 u^2) exp(-u^2) + F_c / v_Coul sech^2(v / v_Coul) + D
        with u = v / v_st. Negative just above the breakaway speed: there a drive may stick-slip.
        """
        share = np.asarray(speed_m_s) / self.stribeck_speed_m_s
        steepness = PEAK_FACTOR * (self.breakaway_n - self.coulomb_n) / self.stribeck_speed_m_s
        rounding = 1.0 - np.tanh(np.asarray(speed_m_s) / self.coulomb_speed_m_s) ** 2
        return (
            steepness * (1.0 - 2.0 * share**2) * np.exp(-(share**2))
            + self.coulomb_n / self.coulomb_speed_m_s * rounding
            + self.viscous_n_s_per_m
        )


@dataclass(frozen=True, slots=True)
class DirectionalFriction:
    """Friction that differs by direction: one set of constants of (5.3.12) for each.

    Real axes have it (the thesis' Figure 5.9; EMPS). The offset must be the same in both, for it
    does not turn with the speed; a level that does is a difference of the Coulomb levels.

    Raises:
        ValueError: the offsets differ.

    >>> forward, backward = Friction(60.0, 60.0, 0.01, 1e-4), Friction(50.0, 50.0, 0.01, 1e-4)
    >>> DirectionalFriction(forward, backward).force_n(np.array([-1.0, 0.0, 1.0])).tolist()
    [-50.0, 0.0, 60.0]
    """

    forward: Friction
    backward: Friction

    def __post_init__(self) -> None:
        if self.forward.offset_n != self.backward.offset_n:
            raise ValueError(
                "offset_n must be the same in both directions, got "
                f"{self.forward.offset_n:g} and {self.backward.offset_n:g}"
            )

    def force_n(self, speed_m_s: Floats | float) -> Floats:
        """Friction force against positive speed, N, in the shape of `speed_m_s` (5.3.12)."""
        return np.where(
            np.asarray(speed_m_s) < 0.0,
            self.backward.force_n(speed_m_s),
            self.forward.force_n(speed_m_s),
        )

    def slope_n_s_per_m(self, speed_m_s: Floats | float) -> Floats:
        """Derivative by the speed, N s/m, in the shape of `speed_m_s`; at rest that forwards."""
        return np.where(
            np.asarray(speed_m_s) < 0.0,
            self.backward.slope_n_s_per_m(speed_m_s),
            self.forward.slope_n_s_per_m(speed_m_s),
        )
