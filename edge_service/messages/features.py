"""Report of the downsampling node on one interval of one axis."""

import math
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import NamedTuple


class Fault(IntFlag):
    """Data faults found inside an interval. `BAD` ones keep the interval from the estimators."""

    NONE = 0
    REPEAT = 1 << 0  # repeated time stamps: the repeats were dropped
    HOLE = 1 << 1  # a few rows missing or not a number, bridged
    GAP = 1 << 2  # more missing than can be bridged
    TIME_BACKWARDS = 1 << 3  # the clock ran backwards: the rows were dropped
    STUCK = 1 << 4  # a channel repeats one value while the axis moves
    IMPLAUSIBLE = 1 << 5  # a step that no machine can make
    SATURATED = 1 << 6  # the torque command stood at its limit
    NO_TORQUE = 1 << 7  # the torque channel is missing
    NO_POSITION = 1 << 8  # no position channel at all
    NO_TABLE = 1 << 9  # the linear encoder is missing, stuck or holed in this interval
    DOUBTED = 1 << 10  # the source itself calls samples of torque or position uncertain
    SPARSE = 1 << 11  # samples too slow for the interval: torque between them is unknown
    TABLE_STUCK = 1 << 12  # the linear encoder stands still while the motor turns
    TABLE_DISAGREES = 1 << 13  # both encoders part further than a sound axis can
    TABLE_DOUBTED = 1 << 14  # the linear encoder has not agreed for long enough again
    TABLE_SHIFTED = 1 << 15  # its level may be another than before it was doubted
    TORQUE_STUCK = 1 << 16  # with STUCK: the torque repeats one value
    ANGLE_STUCK = 1 << 17  # with STUCK: the motor angle repeats one value
    TORQUE_OUTLIERS = 1 << 18  # samples of the torque that no drive can make were left out
    ANGLE_OUTLIERS = 1 << 19
    TABLE_OUTLIERS = 1 << 20
    TORQUE_HELD = 1 << 21  # it repeats its values for longer than at commissioning
    ANGLE_HELD = 1 << 22
    TABLE_HELD = 1 << 23


FAULT_WORDS = {
    Fault.REPEAT: "repeated time stamps",
    Fault.HOLE: "a few samples missing, bridged",
    Fault.GAP: "more samples missing than can be bridged",
    Fault.TIME_BACKWARDS: "the clock of the axis ran backwards",
    Fault.STUCK: "a channel is stuck while the axis moves",
    Fault.IMPLAUSIBLE: "a step that no machine can make",
    Fault.SATURATED: "the torque command stands at its limit",
    Fault.NO_TORQUE: "the torque has no value",
    Fault.NO_POSITION: "the position of the motor has no value",
    Fault.NO_TABLE: "the linear encoder has no value",
    Fault.DOUBTED: "the source calls samples uncertain",
    Fault.SPARSE: "samples too slow to know the torque between them; intervals are wide",
    Fault.TABLE_STUCK: "the linear encoder stands still while the motor turns",
    Fault.TABLE_DISAGREES: "the linear encoder does not follow the motor",
    Fault.TABLE_DOUBTED: "the linear encoder agrees again, but not yet long and fast enough",
    Fault.TABLE_SHIFTED: "the zero of the linear encoder may have shifted",
    Fault.TORQUE_STUCK: "the torque repeats one value while the axis moves",
    Fault.ANGLE_STUCK: "the motor angle stands still while the axis moves",
    Fault.TORQUE_OUTLIERS: "samples of the torque that no drive can make, left out",
    Fault.ANGLE_OUTLIERS: "samples of the motor angle that no drive can make, left out",
    Fault.TABLE_OUTLIERS: "samples of the linear encoder that no drive can make, left out",
    Fault.TORQUE_HELD: "the torque repeats its values for longer than at commissioning",
    Fault.ANGLE_HELD: "the motor angle is held for longer, or coarser, than at commissioning",
    Fault.TABLE_HELD: "the linear encoder is held for longer, or coarser, than at commissioning",
}
"""Kind of fault -> its words, wherever it is told."""

UNUSABLE = Fault.GAP | Fault.TIME_BACKWARDS | Fault.STUCK | Fault.IMPLAUSIBLE
UNUSABLE |= Fault.NO_TORQUE | Fault.NO_POSITION | Fault.TORQUE_HELD | Fault.ANGLE_HELD
"""An interval with one of these is no good data."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Means over the rows of an interval that move steadily in one direction and one phase.

    Torque and acceleration went through the same triangular window, so that
    `torque_nm = J acceleration + friction` holds without any approximation of the motion, and a
    mean over any rows says as much as the rows themselves. Without such rows all is NaN.
    """

    steady_s: float = 0.0  # time of the rows
    torque_nm: float = math.nan
    acceleration_rad_s2: float = math.nan
    speed_rad_s: float = math.nan  # signed
    angle_rad: float = math.nan
    table_m: float = math.nan


PHASES = ("accelerating", "cruising", "braking")
"""Phases of a motion, by the sign of the acceleration along the direction of motion."""


class VibrationColumn(NamedTuple):
    """A feature of a fast sensor, `SENSOR.WHAT`, of the interval of it that ended last."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class FeatureBlock:
    """Sufficient statistics of one interval [start, end) of one axis.

    With torque held between samples (zero-order hold, as a drive applies it), integrals over the
    interval of length T are exact: mean = (1/T) int q dt, lever = (1/T^2) int (T - s) q(s) ds with
    s from the interval's start, so `J d omega = T mean(torque - friction)` and
    `J (d theta - T omega_start) = T^2 lever(torque - friction)` hold without any approximation of
    the motion inside. A value that could not be measured is NaN.
    """

    time_s: float  # end of the interval on the axis' clock, s
    duration_s: float  # T, s
    sample_count: int  # good samples inside
    fault: Fault  # data faults found inside

    torque_mean_nm: float
    torque_lever_nm: float
    torque_min_nm: float
    torque_max_nm: float
    torque_std_nm: float

    angle_start_rad: float
    angle_end_rad: float
    angle_mean_rad: float
    speed_start_rad_s: float  # instantaneous speed at the interval's start, from the angle
    speed_end_rad_s: float
    speed_min_rad_s: float
    speed_max_rad_s: float

    direction_mean: float  # mean of sgn(speed), in [-1, 1]
    direction_lever: float  # lever of sgn(speed)
    moving_fraction: float  # share of the interval spent above the standstill speed
    reversal_count: int  # changes of direction inside, or against the last known direction
    since_reversal_s: float  # time of unbroken motion up to the interval's start, s

    table_start_m: float
    table_end_m: float
    table_mean_m: float
    temperature_c: float
    external_force_n: float

    steady_direction: float = 0.0  # of the rows behind the phases, -1 or 1; 0 without any
    accelerating: Phase = Phase()
    cruising: Phase = Phase()
    braking: Phase = Phase()
    vibration: tuple[VibrationColumn, ...] = ()

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases in which the axis moved steadily."""
        every = (self.accelerating, self.cruising, self.braking)
        return tuple(phase for phase in every if phase.steady_s > 0.0)

    @property
    def usable(self) -> bool:
        """Return whether an estimator may read this interval as good data."""
        return not int(self.fault) & int(UNUSABLE)


PHASE_FIELDS = tuple(field.name for field in fields(Phase))
FEATURE_FIELDS = tuple(
    field.name for field in fields(FeatureBlock) if field.name not in {*PHASES, "vibration"}
)
"""Names of the numbers of a block beside those of its phases and of fast sensors."""
