"""Limits on where, how fast and how hard an axis may go, and what asks for more."""

import math
from dataclasses import dataclass

from ...exit_status import BadInputError
from ..machine import Machine
from ..plant.controller import MAX_TORQUE_NM

DEFAULT_STROKE_M = 0.8
DEFAULT_SPEED_RAD_S = 628.0  # 6000 rpm, Table A.4
DEFAULT_SPEED_M_S = 2.0  # 6000 rpm at that lead
DEFAULT_ACCELERATION_M_S2 = 4.0
RAPID_M_S = 0.5  # speed of ordinary moves; only tests that name their speeds go beyond it
STROKE_MARGIN = 0.05
"""Share of the stroke that a motion leaves free at either end."""
TORQUE_SHARE = 0.5  # of its limit, for acceleration; the rest is for friction, forces and control
_ROUNDING = 1.0 + 1e-9


class MotionError(BadInputError, ValueError):
    """A motion that cannot be run as asked; the text is one line."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of an axis, in m and s, all rates greater than 0, and the torque that motion takes."""

    low_m: float
    high_m: float
    speed_m_s: float = DEFAULT_SPEED_M_S
    acceleration_m_s2: float = DEFAULT_ACCELERATION_M_S2
    jerk_m_s3: float = 200.0  # of moves; acceleration and torque alone bound excitations
    lead_m: float = 0.02  # travel per revolution of the screw (Table A.1)
    torque_nm: float = math.inf  # at the motor
    inertia_nm_s2_per_m: float = 0.0  # rigid, torque per acceleration
    viscous_nm_s_per_m: float = 0.0
    drag_nm: float = 0.0

    @property
    def span_m(self) -> float:
        """Length of the usable stroke, m."""
        return self.high_m - self.low_m

    @property
    def rapid_m_s(self) -> float:
        """Speed of ordinary moves, m/s: friction leaves room for the full acceleration."""
        speed = min(RAPID_M_S, self.speed_m_s)
        if self.viscous_nm_s_per_m > 0.0:
            spare_nm = self.torque_nm - self.taken_nm(0.0, self.acceleration_m_s2)
            speed = min(speed, spare_nm / self.viscous_nm_s_per_m)
        return speed

    def taken_nm(self, speed_m_s: float, acceleration_m_s2: float) -> float:
        """Torque for both magnitudes at once, N m: a bound where they are peaks of one segment."""
        smooth = self.inertia_nm_s2_per_m * acceleration_m_s2
        return smooth + self.viscous_nm_s_per_m * speed_m_s + self.drag_nm

    def excess(
        self, *, speed_m_s: float = 0.0, acceleration_m_s2: float = 0.0, length_m: float = 0.0
    ) -> str | None:
        """The first limit that magnitudes break, with what is asked and allowed; None if none."""
        torque_nm = self.taken_nm(speed_m_s, acceleration_m_s2)
        for name, unit, asked, allowed in (
            ("speed", "mm/min", 6e4 * speed_m_s, 6e4 * self.speed_m_s),
            ("acceleration", "m/s2", acceleration_m_s2, self.acceleration_m_s2),
            ("stroke", "mm", 1e3 * length_m, 1e3 * self.span_m),
            ("torque", "N m", torque_nm, self.torque_nm),
        ):
            if asked > allowed * _ROUNDING:
                much, most = (f"{float(f'{each:.4g}'):g} {unit}" for each in (asked, allowed))
                return f"{name}: asks for {much}, the axis allows {most}"
        return None


def motion_limits(machine: Machine) -> MotionLimits:
    """Limits from the machine file's axis table, and the defaults above for what it lacks.

    Raises MotionError: the drag alone takes the share of the torque that is not for acceleration.
    """
    axis, model, ratio = machine.axis, machine.model, machine.transmission_ratio_m_per_rad
    max_torque = axis.max_torque_nm or MAX_TORQUE_NM
    drag = model.preload_drag_nm.value if model.preload_drag_nm else 0.0
    drag += machine.other_drag_nm.value
    if drag >= (1.0 - TORQUE_SHARE) * max_torque:
        raise MotionError(
            f"axis.max_torque_nm: {max_torque:g} N m against a drag of {drag:g} N m leaves "
            "less than half for motion"
        )
    inertia = model.inertia_kg_m2.value / ratio
    strongest = TORQUE_SHARE * max_torque / inertia
    stroke = axis.stroke_m or DEFAULT_STROKE_M
    return MotionLimits(
        low_m=STROKE_MARGIN * stroke,
        high_m=(1.0 - STROKE_MARGIN) * stroke,
        speed_m_s=(axis.max_speed_rad_s or DEFAULT_SPEED_RAD_S) * ratio,
        acceleration_m_s2=min(axis.max_acceleration_m_s2 or DEFAULT_ACCELERATION_M_S2, strongest),
        lead_m=axis.lead_m,
        torque_nm=max_torque,
        inertia_nm_s2_per_m=inertia,
        viscous_nm_s_per_m=model.viscous_nm_s_per_rad.value / ratio,
        drag_nm=drag,
    )


def assumed_limits(machine: Machine) -> tuple[str, ...]:
    """Keys of the machine file whose place a default of `motion_limits` takes."""
    keys = ("stroke_m", "max_speed_rad_s", "max_acceleration_m_s2", "max_torque_nm")
    return tuple(f"axis.{key}" for key in keys if getattr(machine.axis, key) is None)
