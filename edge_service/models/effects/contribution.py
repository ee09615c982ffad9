"""Contributions of an effect to an axis: a small closed set.

Each is a number or a function of one variable. The same function is evaluated on measured motion
(`signature`) and on the grids of the simulated plant (`forward`), so both mean the same physics.
Torques are those that the motor must give in addition; directions are those of positive motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ...messages.samples import Floats

Curve = Callable[[Floats], Floats]
"""A function of one variable, (n,) -> (n,)."""


HOUSING_LAG_S = 180.0
"""Assumption: time constant of the nut's housing behind screw and lubricant."""
HOLDING = 0.05
"""Dry friction that holds a table within its play over the whole level, if the model has none."""


class Over(StrEnum):
    """The variable of a curve."""

    SPEED = "motor_speed_rad_s"  # signed
    ANGLE = "motor_angle_rad"  # a curve over it has the period 2 pi
    POSITION = "table_position_m"
    TIME = "time_s"  # since the beginning of the recording
    TEMPERATURE = "temperature_c"  # as the housing's sensor reads it; nothing without one


class Side(StrEnum):
    """Side of the friction: before the spring, behind it, or shared as the Coulomb level is."""

    MOTOR = "motor"
    TABLE = "table"
    AS_DRAG = "as_drag"

    def table_share(self, of_drag: float) -> float:
        """Share behind the spring, where that of the Coulomb level is `of_drag`."""
        return {Side.MOTOR: 0.0, Side.TABLE: 1.0, Side.AS_DRAG: of_drag}[self]


class Place(StrEnum):
    """Object of a shift: the nut along the screw, m, or the reading of the motor's angle, rad."""

    NUT = "nut"
    ANGLE_READING = "angle_reading"


class Constant(StrEnum):
    """A constant of the axis that an effect adds to."""

    TABLE_INERTIA = "table_inertia_kg_m2"  # at the motor
    VISCOUS = "viscous_nm_s_per_rad"
    COMMAND_SHARE = "command_share"  # command per torque that arrives, minus 1
    TORQUE_LIMIT = "torque_limit_nm"  # of what arrives; the least one counts
    TORQUE_LAG = "torque_lag_s"
    POSITION_LAG = "position_lag_s"  # of the linear encoder behind the rotary one
    COMPLIANCE = "compliance_m_per_n"
    COMPLIANCE_SLOPE = "compliance_slope_per_n"  # m/N per m of position
    COULOMB_LOAD_COMPLIANCE = "coulomb_load_compliance_m_per_n"  # of dry friction, more
    COULOMB_LOAD_COMPLIANCE_SLOPE = "coulomb_load_compliance_slope_per_n"
    VISCOUS_LOAD_COMPLIANCE = "viscous_load_compliance_m_per_n"  # of viscous friction
    VISCOUS_LOAD_COMPLIANCE_SLOPE = "viscous_load_compliance_slope_per_n"
    PRESLIDING_REACH = "presliding_reach_m"


@dataclass(frozen=True, slots=True)
class DryFriction:
    """Dry friction, N m: against the motion, and holding at rest; parts may be negative."""

    over: Over
    level_nm: Curve
    side: Side


@dataclass(frozen=True, slots=True)
class ViscousFriction:
    """Viscous friction of the motor side over time or temperature, N m s/rad; may be negative."""

    over: Over
    per_speed: Curve


@dataclass(frozen=True, slots=True)
class SmoothTorque:
    """A torque, N m, that does not turn with the direction of motion."""

    over: Over
    torque_nm: Curve
    side: Side


@dataclass(frozen=True, slots=True)
class TableForce:
    """A force on the table over time, N, positive along x."""

    force_n: Curve


@dataclass(frozen=True, slots=True)
class Shift:
    """A shift over angle or, for the nut, position, in the unit of its place."""

    place: Place
    over: Over
    shift: Curve


@dataclass(frozen=True, slots=True)
class Play:
    """Clearance between screw and table, whose flank is that of the load."""

    width_m: float
    friction_share: float  # dry friction that holds the table, over what the model has there
    viscous_share: float  # of the viscous friction that holds it


@dataclass(frozen=True, slots=True)
class PreslidingWindUp:
    """Dry friction that loads a spring only as the motor travels, by way of its bristles.

    What a spring gives for dry friction that turns at once is corrected by it: an axis that rests
    unwinds while its motor creeps. Only the signature needs it: in the simulated plant it follows
    from the spring and a table that truly sticks.
    """

    level_m_per_n: float
    slope_per_n: float
    friction_share: float  # dry friction that the spring carries, over the table's in the model
    reach_m: float  # travel of the motor over which friction builds up


@dataclass(frozen=True, slots=True)
class LoadFriction:
    """Friction torque per torque that the screw carries to the table."""

    coefficient: float
    friction_share: float  # dry friction that it carries, over the table's in the model
    viscous_share: float  # of the viscous friction that it carries


@dataclass(frozen=True, slots=True)
class Strain:
    """Growth of the screw over time or temperature, m of shift per m from the fixed bearing."""

    over: Over
    strain: Curve


@dataclass(frozen=True, slots=True)
class Change:
    """A constant of the axis changed by `value`."""

    quantity: Constant
    value: float


@dataclass(frozen=True, slots=True)
class Warming:
    """Reading of the housing's sensor above the surroundings over time, K; the greatest counts."""

    rise_k: Curve


Contribution = (
    DryFriction
    | ViscousFriction
    | SmoothTorque
    | TableForce
    | LoadFriction
    | PreslidingWindUp
    | Play
    | Shift
    | Strain
    | Change
    | Warming
)


def lagged_warming(final_rise_k: float, time_constant_s: float) -> Warming:
    """The housing of a part that warms up by T (1 - exp(-t / tau)).

    T (1 - (tau exp(-t / tau) - s exp(-t / s)) / (tau - s)) with s = `HOUSING_LAG_S`: a step behind
    two first-order lags.
    """
    tau, lag = time_constant_s, HOUSING_LAG_S
    if abs(tau - lag) < 1e-3 * lag:
        tau = lag * 1.001  # the limit, for all that a sensor can tell

    def rise_k(time_s: Floats) -> Floats:
        left = tau * np.exp(-time_s / tau) - lag * np.exp(-time_s / lag)
        return np.asarray(final_rise_k * (1.0 - left / (tau - lag)))

    return Warming(rise_k)


def constant(value: float) -> Curve:
    """The curve that has this value everywhere."""
    return lambda variable: np.full_like(variable, value)


@dataclass(frozen=True, slots=True)
class Harmonic:
    """The curve A sin(n theta + phi) over the angle theta, in the unit of the amplitude A."""

    amplitude: float
    order: float
    phase_rad: float

    def __call__(self, angle_rad: Floats) -> Floats:
        """Values, (n,)."""
        return self.amplitude * np.sin(self.order * angle_rad + self.phase_rad)

    def derivatives(self, angle_rad: Floats) -> tuple[Floats, Floats]:
        """First and second derivative by the angle, (n,) each."""
        turned_rad = self.order * angle_rad + self.phase_rad
        slope = self.order * self.amplitude
        return slope * np.cos(turned_rad), -self.order * slope * np.sin(turned_rad)
