"""Limits to the parting of a sound axis' encoders, from the machine and not from one axis."""

import math
from dataclasses import dataclass, replace

from ...models.machine import Machine
from ...models.screw.stiffness import STEEL_MODULUS_PA, screw_area

LEAST_PLAY_M = 50e-6
PLAY_PER_LEAD = 0.01
"""Worn nuts have some hundredths of a millimetre of play, larger balls (longer leads) more."""
PERIODIC_PER_LEAD = 1e-3
"""Error of the lead within a turn, and of an encoder within its period, per lead."""
SOFTEST_N_PER_M = 1e7
"""No axis without known geometry is taken to be softer than this."""
SOFTER_THAN_SCREW = 5.0
"""Nut and bearings, also worn ones, beside the screw alone."""
SOFTER_THAN_COMMISSIONED = 3.0
"""A nut that loses its preload, and the far end of the stroke."""
DYNAMIC = 2.0
"""A step of force stretches an undamped spring twice as far as the force at rest."""
GROWTH_PER_LENGTH_S = 12e-6 / 60.0
MOST_GROWTH = 12e-6 * 30.0
"""Growth of a steel screw per length, 1/s and in all: one kelvin a minute, thirty kelvins."""
LONGEST_SCREW_M = 1.0
COARSER = 4.0  # variance of its rounding over all noise at commissioning: another resolution
FASTEST_S = 1e-3  # period of samples as fast as a drive holds its torque, where none is stated


@dataclass(frozen=True, slots=True)
class ChannelLimits:
    """Limits of the difference between the encoders of a sound axis."""

    ratio_m_per_rad: float  # table travel per radian of the screw
    play_m: float  # greatest play at one reversal
    compliance_m_per_n: float = 1.0 / SOFTEST_N_PER_M  # stretch per force, on the generous side
    length_m: float = LONGEST_SCREW_M  # of the screw that warms up
    skew_s: float = 0.0  # lag of the table's samples at commissioning
    # for which torque, motor angle and table repeated a value then; None if unknown
    hold_s: tuple[float, float, float] | None = None
    # resolution of each, in its unit, that may still be that of commissioning
    coarsest: tuple[float, float, float] = (math.inf, math.inf, math.inf)

    @classmethod
    def of_ratio(cls, ratio_m_per_rad: float) -> "ChannelLimits":
        """Limits of an axis of which only the lead is known."""
        lead_m = 2.0 * math.pi * ratio_m_per_rad
        return cls(ratio_m_per_rad, max(LEAST_PLAY_M, PLAY_PER_LEAD * lead_m))

    @property
    def periodic_m(self) -> float:
        """Error that returns with each turn of the screw, m."""
        return PERIODIC_PER_LEAD * 2.0 * math.pi * self.ratio_m_per_rad

    def stretch_m(self, torque_span_nm: float) -> float:
        """Greatest stretch with a change of torque, m; where none is known, as much as play."""
        if math.isnan(torque_span_nm):
            return self.play_m
        return DYNAMIC * self.compliance_m_per_n * torque_span_nm / self.ratio_m_per_rad

    @property
    def growth_m(self) -> float:
        return self.length_m * MOST_GROWTH


def channel_limits(machine: Machine) -> ChannelLimits:
    """Limits of a machine, commissioned or nominal."""
    plain = ChannelLimits.of_ratio(machine.transmission_ratio_m_per_rad)
    length_m = machine.axis.screw_length_m or machine.axis.stroke_m or LONGEST_SCREW_M
    limits = replace(plain, compliance_m_per_n=_compliance(machine), length_m=length_m)
    if (commissioned := machine.commissioned) is None:
        return limits
    limits = replace(limits, hold_s=commissioned.hold_s)
    if (told := commissioned.transmission) is None:
        return limits
    period_s = commissioned.sample_period_s or FASTEST_S
    coarsest_m = math.sqrt(12.0 * COARSER * told.noise_density_m2_s / period_s)
    coarsest = math.inf, coarsest_m / limits.ratio_m_per_rad, coarsest_m
    return replace(limits, skew_s=told.clock_skew_s, coarsest=coarsest)


def _compliance(machine: Machine) -> float:
    """Greatest compliance between motor and table, m/N."""
    commissioned, axis, model = machine.commissioned, machine.axis, machine.model
    if commissioned is not None and commissioned.transmission is not None:
        whole_kg = model.inertia_kg_m2.value / machine.transmission_ratio_m_per_rad**2
        mass_kg = 0.5 * whole_kg if model.table_mass_kg is None else model.table_mass_kg.value
        stretched_s2 = commissioned.transmission.stretch_per_acceleration_s2
        return SOFTER_THAN_COMMISSIONED * stretched_s2 / mass_kg
    if axis.screw_diameter_m is None:
        return 1.0 / SOFTEST_N_PER_M
    length_m = axis.screw_length_m or axis.stroke_m or LONGEST_SCREW_M
    rigidity_n = STEEL_MODULUS_PA * screw_area(axis.screw_diameter_m)
    return SOFTER_THAN_SCREW * length_m / rigidity_n
