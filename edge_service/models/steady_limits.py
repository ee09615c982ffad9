"""Limits of steady motion and of cruising, by how fast an axis moves; how long torque is held."""

from dataclasses import dataclass

from .machine import Machine

SLOWEST_RAD_S, CRUISE_RAD_S2 = 2.0, 30.0
"""Of an axis that is fast enough for them; a slower one has less."""
SPEED_SHARE, ACCELERATION_SHARE = 1.0 / 75.0, 0.1
"""Of the fastest motion: slower is creeping, and more is accelerating."""
LONGEST_HOLD_S = 0.0045
"""A drive holds its torque command from one cycle of its position control to the next; such cycles
last 4 ms at most. Slower samples are points of a torque that goes on between them."""


@dataclass(frozen=True, slots=True)
class SteadyLimits:
    """Limits within which motion is steady."""

    slowest_rad_s: float = SLOWEST_RAD_S  # slower is left out (Stribeck friction, creeping jogs)
    cruise_rad_s2: float = CRUISE_RAD_S2  # up to this acceleration the axis cruises

    def for_motion(
        self, top_speed_rad_s: float | None, top_acceleration_rad_s2: float | None
    ) -> "SteadyLimits":
        """Lower ones where the fastest motion asks for them; None is unknown."""
        slowest, cruise = self.slowest_rad_s, self.cruise_rad_s2
        if top_speed_rad_s:
            slowest = min(slowest, SPEED_SHARE * top_speed_rad_s)
        if top_acceleration_rad_s2:
            cruise = min(cruise, ACCELERATION_SHARE * top_acceleration_rad_s2)
        return SteadyLimits(slowest, cruise)


def steady_limits(machine: Machine) -> SteadyLimits:
    """As commissioned, or as the axis' stated limits ask for."""
    axis, known = machine.axis, machine.commissioned
    if known is not None:
        return SteadyLimits(
            known.slowest_rad_s or SLOWEST_RAD_S, known.cruise_rad_s2 or CRUISE_RAD_S2
        )
    acceleration = axis.max_acceleration_m_s2
    return SteadyLimits().for_motion(
        axis.max_speed_rad_s,
        acceleration / machine.transmission_ratio_m_per_rad if acceleration else None,
    )
