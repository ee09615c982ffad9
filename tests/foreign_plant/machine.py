"""Data sheet of the axis, and its machine file."""

from dataclasses import dataclass

import numpy as np

HERTZ_SHARE = 0.8  # (5.3.11): nut stiffness = 0.8 K (F_p / 0.1 C_a)^(1/3)


@dataclass(frozen=True, slots=True)
class Machine:
    """Nominal axis; the true one differs by about a percent."""

    kind: str = "estimator"  # or "diagnosis": nearly rigid, all Coulomb friction in one number
    lead_m: float = 0.02
    stroke_m: float = 0.8
    screw_diameter_m: float = 0.02
    screw_length_m: float = 0.998
    dynamic_load_rating_n: float = 7450.0
    inertia_kg_m2: float = 1.5e-3
    table_mass_kg: float = 23.5
    screw_inertia_kg_m2: float = 1.22e-4
    viscous_nm_s_per_rad: float = 5.0e-3
    preload_n: float = 510.0
    preload_drag_nm: float = 0.146
    bearing_drag_nm: float = 0.05
    guide_force_n: float = 60.0
    nut_rigidity_n_per_m: float = 1.6e8  # K in (5.3.11)
    stiffness_scale: float = 1.0

    @property
    def lead_rad(self) -> float:
        return self.lead_m / (2 * np.pi)

    @property
    def coulomb_nm(self) -> float:
        return self.preload_drag_nm + self.bearing_drag_nm + self.guide_force_n * self.lead_rad

    @property
    def preload_percent(self) -> float:
        return 100.0 * self.preload_n / self.dynamic_load_rating_n

    @property
    def nut_stiffness_n_per_m(self) -> float:
        share = self.preload_n / (0.1 * self.dynamic_load_rating_n)
        return float(
            HERTZ_SHARE * self.nut_rigidity_n_per_m * self.stiffness_scale * np.cbrt(share)
        )

    @property
    def hertz_n_per_m15(self) -> float:
        """C of F = C d^1.5 whose pair is as stiff as (5.3.11): 3 C^(2/3) F_p^(1/3)."""
        return float((self.nut_stiffness_n_per_m / (3.0 * np.cbrt(self.preload_n))) ** 1.5)


DIAGNOSIS = Machine(kind="diagnosis", stiffness_scale=300.0)


def nominal_machine_toml(machine: Machine) -> str:
    def number(value: float, tolerance: float) -> str:
        return f"{{ value = {value!r}, tolerance = {tolerance!r} }}"

    diagnosis = machine.kind == "diagnosis"
    drag = machine.coulomb_nm if diagnosis else machine.preload_drag_nm
    lines = [
        "[axis]",
        'name = "X"',
        f"lead_m = {machine.lead_m!r}",
        f"stroke_m = {machine.stroke_m!r}",
        f"screw_diameter_m = {machine.screw_diameter_m!r}",
        f"screw_length_m = {machine.screw_length_m!r}",
        f"dynamic_load_rating_n = {machine.dynamic_load_rating_n!r}",
        'bearing_arrangement = "fixed-free"',
        "",
        "[model]",
        f"inertia_kg_m2 = {machine.inertia_kg_m2!r}",
        f"viscous_nm_s_per_rad = {machine.viscous_nm_s_per_rad!r}",
        f"preload_drag_nm = {drag!r}",
    ]
    if not diagnosis:
        lines.append(f"preload_n = {machine.preload_n!r}")
        lines.append(f"nut_stiffness_n_per_m = {number(machine.nut_stiffness_n_per_m, 0.1)}")
        lines.append(f"table_mass_kg = {number(machine.table_mass_kg, 0.02)}")
    return "\n".join(lines) + "\n"
