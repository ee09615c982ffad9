"""Measured motion, and the baseline model that says what torque it needs."""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from ...messages.samples import Floats
from ..machine import Machine
from ..plant.from_machine import plant_of
from ..plant.two_mass import axial_compliance
from ..screw.ball_screw import table_inertia

_COMPLIANCE_POINTS = 129


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """The numbers of a machine file that signatures need."""

    ratio_m_per_rad: float
    inertia_kg_m2: float  # of the whole axis, at the motor
    table_inertia_kg_m2: float
    viscous_nm_s_per_rad: float
    coulomb_nm: float  # the whole level of dry friction
    table_coulomb_nm: float  # of it what acts on the table
    position_m: Floats  # places, (k,), of
    compliance_m_per_n: Floats  # the spring, (k,)
    torque_limit_nm: float = math.inf  # of the drive; infinite where none is stated

    @classmethod
    def of_machine(cls, machine: Machine) -> Self:
        """The baseline of a machine file, completed by the thesis' bench where it is silent.

        Raises ValueError: the table is heavier than the whole inertia.
        """
        plant = plant_of(machine)
        ratio = plant.ratio_m_per_rad
        guide_nm = plant.guide_force_n * ratio
        position = np.linspace(0.0, plant.screw_length_m, _COMPLIANCE_POINTS)
        percent = machine.fresh_preload_percent or 0.0
        return cls(
            ratio_m_per_rad=ratio,
            inertia_kg_m2=machine.model.inertia_kg_m2.value,
            table_inertia_kg_m2=table_inertia(plant.table_mass_kg, machine.axis.lead_m),
            viscous_nm_s_per_rad=machine.model.viscous_nm_s_per_rad.value,
            coulomb_nm=machine.fresh_drag_nm + plant.bearing_drag_nm + guide_nm,
            table_coulomb_nm=guide_nm,
            position_m=position,
            compliance_m_per_n=np.array([axial_compliance(plant, x, percent) for x in position]),
            torque_limit_nm=machine.axis.max_torque_nm or math.inf,
        )

    @property
    def table_share(self) -> float:
        """Share of the dry friction that acts on the table; 0 without any friction."""
        return self.table_coulomb_nm / self.coulomb_nm if self.coulomb_nm > 0.0 else 0.0

    def wind_up_m(self, carried_nm: Floats, position_m: Floats) -> Floats:
        """x - R theta where the spring carries a torque: -c(x) T / R, m, (n,)."""
        compliance = np.interp(position_m, self.position_m, self.compliance_m_per_n)
        return np.asarray(-compliance * carried_nm / self.ratio_m_per_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Measured motion of one axis, filtered as the user of signatures likes; all (n,)."""

    time_s: Floats  # increasing, from the beginning of the recording
    angle_rad: Floats
    speed_rad_s: Floats
    acceleration_rad_s2: Floats
    table_rad_s2: Floats  # the table's over the ratio; the motor's where that is not measured
    position_m: Floats
    direction: Floats  # of the motor's motion: -1, 0 or 1
    torque_nm: Floats  # commanded; NaN where unknown
    model_torque_nm: Floats  # what the baseline needs for this motion (zero at rest)
    load_torque_nm: Floats  # of it, without friction, what the spring to the table carries
    temperature_c: Floats  # of the housing; NaN where unknown
    approach: Floats = field(init=False)  # direction of the latest motion; before any, home's: 1

    def __post_init__(self) -> None:
        """Look once for what many signatures ask for."""
        latest = np.maximum.accumulate(np.where(self.direction != 0.0, np.arange(len(self)), -1))
        approach = np.where(latest >= 0, self.direction[latest], 1.0)
        object.__setattr__(self, "approach", approach)

    @classmethod
    def of_samples(
        cls,
        baseline: Baseline,
        time_s: Floats,
        angle_rad: Floats,
        speed_rad_s: Floats,
        acceleration_rad_s2: Floats,
        *,
        position_m: Floats | None = None,
        torque_nm: Floats | None = None,
        external_force_n: Floats | None = None,
        temperature_c: Floats | None = None,
        table_rad_s2: Floats | None = None,
        still_rad_s: float = 0.0,
    ) -> Self:
        """Motion with what the baseline says of it.

        The table's position is by the motor's angle unless given, a known force positive along x;
        up to `still_rad_s` the axis is at rest.
        """
        direction = np.where(np.abs(speed_rad_s) > still_rad_s, np.sign(speed_rad_s), 0.0)
        force = 0.0 if external_force_n is None else external_force_n
        pushed_nm, unknown = -baseline.ratio_m_per_rad * force, np.full_like(time_s, np.nan)
        table_rad_s2 = acceleration_rad_s2 if table_rad_s2 is None else table_rad_s2
        load = baseline.table_inertia_kg_m2 * table_rad_s2 + pushed_nm
        whole = load + (baseline.inertia_kg_m2 - baseline.table_inertia_kg_m2) * acceleration_rad_s2
        whole += baseline.viscous_nm_s_per_rad * speed_rad_s + baseline.coulomb_nm * direction
        position_m = baseline.ratio_m_per_rad * angle_rad if position_m is None else position_m
        torque_nm = unknown if torque_nm is None else torque_nm
        temperature_c = unknown if temperature_c is None else temperature_c
        known = position_m, direction, torque_nm, whole, load, temperature_c
        return cls(time_s, angle_rad, speed_rad_s, acceleration_rad_s2, table_rad_s2, *known)

    def __len__(self) -> int:
        return int(self.time_s.shape[0])
