"""Everything one run needs, drawn from the nominal axis; faults and ageing edit it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .drive import SLOW, Drive
from .machine import HERTZ_SHARE, Machine
from .sensors import Sensors

Array = NDArray[np.float64]
SLOW_STEP_S = 0.01
NODES = 81  # points along the stroke


@dataclass(slots=True)
class Plan:
    """One run before it is run. Tables of waves hold rows (order, amplitude, phase, corner)."""

    machine: Machine
    setpoint_m: Array
    drive: dict[str, float]
    slow: dict[str, Array]
    push_n: Array
    growth_m: Array
    walk_m: Array
    rub_n: Array
    sensors: Sensors
    elapsed_s: float = 0.0  # of this session, before the recording
    waves: dict[str, list[tuple[float, float, float, float]]] = field(
        default_factory=lambda: {"ripple": [], "lead": [], "disc": [], "rev": []}
    )
    record: list[Any] = field(default_factory=list)  # edits of the recorded columns, in order
    truth: dict[str, Any] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        return len(self.setpoint_m)

    @property
    def slow_time_s(self) -> Array:
        return np.arange(self.samples // 10 + 1) * SLOW_STEP_S

    @property
    def speed_m_s(self) -> Array:
        return np.gradient(self.setpoint_m, 1e-3)

    def slow_speed_m_s(self) -> Array:
        speed = np.abs(self.speed_m_s)
        padded = np.pad(speed, (0, len(self.slow_time_s) * 10 - len(speed)), mode="edge")
        return padded.reshape(-1, 10).mean(axis=1)

    def scale(self, **shares: float) -> None:
        for name, share in shares.items():
            self.drive[name] *= share

    def waves_table(self, name: str) -> Array:
        return np.array(self.waves[name], dtype=float).reshape(-1, 4)

    def slow_table(self) -> Array:
        return np.column_stack([self.slow[name] for name in SLOW])


def draw(rng: np.random.Generator, share: float) -> float:
    """A factor about one; never further than two and a half spreads."""
    return float(1.0 + share * np.clip(rng.standard_normal(), -2.5, 2.5))


DRIFT = 0.01


def plan_axis(machine: Machine, setpoint_m: Array, axis_seed: int) -> Plan:
    """The true axis of `axis_seed`: nominal numbers off by `DRIFT`, unstated ones by much more."""
    rng = np.random.default_rng([axis_seed, 7])
    stiff = machine.kind == "diagnosis"
    scale = machine.stiffness_scale
    loose = 1.0 if not stiff else DRIFT / 0.1  # what the diagnosis' baseline states is well known
    wide = 0.1 * loose
    inertia = machine.inertia_kg_m2 * draw(rng, DRIFT)
    mass = machine.table_mass_kg * draw(rng, 0.5 * DRIFT)
    j_screw = machine.screw_inertia_kg_m2
    hertz = machine.hertz_n_per_m15 * draw(rng, 0.0 if stiff else 0.05)
    bearing_c = machine.bearing_drag_nm * draw(rng, wide)
    guide_c = machine.guide_force_n * draw(rng, wide)
    nut_c = machine.preload_drag_nm * draw(rng, DRIFT)
    viscous = machine.viscous_nm_s_per_rad * draw(rng, DRIFT)
    trace = 0.1 if stiff else 1.0
    drive = Drive()._asdict() | {
        "lead_rad": machine.lead_rad,
        "stroke": machine.stroke_m,
        "j_motor": inertia - j_screw - mass * machine.lead_rad**2,
        "j_screw": j_screw,
        "bearing_c": bearing_c,
        "guide_c": guide_c,
        "bearing_excess": 0.15 * trace * draw(rng, 0.3),
        "nut_excess": 0.15 * trace * draw(rng, 0.3),
        "guide_excess": 0.25 * trace * draw(rng, 0.3),
        "bearing_vs": 2.0 * draw(rng, 0.2),
        "nut_vs": 3.0 * draw(rng, 0.2),
        "guide_vs": 0.006 * draw(rng, 0.2),
        "bearing_visc": 0.4 * viscous,
        "nut_visc": 0.3 * viscous,
        "guide_visc": 0.3 * viscous / machine.lead_rad**2,
        "coupling_k": 3850.0 * scale * draw(rng, 0.1),
        "shaft_gj": 656.0 * scale * draw(rng, 0.03),
        "bearing_k": 2.0e8 * scale * draw(rng, 0.1),
        "shaft_ae": 4.7e7 * scale * draw(rng, 0.03),
        "nut_hertz": hertz,
        "clearance": rng.uniform(1.0e-6, 2.0e-6) if not stiff else 0.0,
        "gain": draw(rng, 0.5 * DRIFT),
        "ff_j": machine.inertia_kg_m2,
        "kv": rng.uniform(40.0, 80.0),
        "kp": rng.uniform(0.4, 0.7),
        "ti": rng.uniform(0.012, 0.03),
    }
    drive |= damping(drive, mass, stiff)
    steps = len(setpoint_m) // 10 + 1
    ones = np.ones(steps)
    plan = Plan(
        machine=machine,
        setpoint_m=np.asarray(setpoint_m, dtype=float),
        drive=drive,
        slow={
            "preload_n": ones * machine.preload_n,
            "table_kg": ones * mass,
            "bearing": ones.copy(),
            "nut": ones.copy(),
            "guide": ones.copy(),
            "viscous": ones.copy(),
            "nut_drag_per_n": ones * nut_c / machine.preload_n,
        },
        push_n=np.zeros(len(setpoint_m)),
        growth_m=np.zeros((2, NODES)),
        walk_m=np.zeros(NODES),
        rub_n=np.zeros(NODES),
        sensors=Sensors(speed_lag_s=rng.uniform(3e-4, 1e-3)),
    )
    for order in (4.0, 8.0):
        amplitude = 0.02 * trace * draw(rng, 0.3)
        plan.waves["ripple"].append((order, amplitude, rng.uniform(0, 2 * np.pi), 1e6))
    plan.truth["parameters"] = drive
    return plan


def damping(drive: dict[str, float], mass: float, stiff: bool) -> dict[str, float]:
    """Structural damping of the two springs as a share of critical."""
    share = 0.25 if stiff else 0.04
    axial_k = 1.0 / (1.0 / drive["bearing_k"] + 0.4 / drive["shaft_ae"])
    twist_k = 1.0 / (1.0 / drive["coupling_k"] + 0.4 / drive["shaft_gj"])
    screw_kg = drive["j_screw"] / drive["lead_rad"] ** 2
    light = 1.0 / (1.0 / mass + 1.0 / screw_kg)
    return {
        "axial_d": 2.0 * share * float(np.sqrt(axial_k * light)),
        "torsion_d": 2.0 * share * float(np.sqrt(twist_k * drive["j_screw"])),
    }


def substeps(drive: dict[str, float], mass: float) -> int:
    """Integration steps per speed-loop tick that keep the fastest mode at one radian or less."""
    nut_k = HERTZ_SHARE * drive["nut_hertz"] ** (2 / 3) * 40.0
    axial = 1.0 / (
        1.0 / drive["bearing_k"] + drive["shaft_start"] / drive["shaft_ae"] + 1.0 / nut_k
    )
    twist = 1.0 / (1.0 / drive["coupling_k"] + drive["shaft_start"] / drive["shaft_gj"])
    screw = (twist + axial * drive["lead_rad"] ** 2) / drive["j_screw"]
    fastest = float(np.sqrt(screw + axial / mass + twist / drive["j_motor"]))
    return int(np.clip(np.ceil(125e-6 * fastest / 0.9), 4, 40))
