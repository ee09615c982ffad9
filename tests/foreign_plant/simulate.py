"""Case -> Recording: plan, age, damage, run, record."""

import csv
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import ageing
from .drive import Drive
from .kernel import run
from .machine import Machine
from .oddities import ALL
from .plan import Plan, plan_axis, substeps
from .sensors import record

Array = NDArray[np.float64]
LEAD_IN_S = 1.5
LEAD_IN_M = 3e-3


@dataclass(frozen=True, slots=True)
class Case:
    """One recording to make. The same `axis_seed` is the same axis with the same faults."""

    machine: Machine
    setpoint_m: Array  # at 1 kHz
    seed: int = 0
    axis_seed: int = 0
    preload: ageing.PreloadSpec | None = None  # percent; None: the fresh screw
    events: tuple[ageing.Event, ...] = ()
    effects: tuple[tuple[str, float], ...] = ()  # (name, strength)
    stroke_map: tuple[float, float] = (0.0, 0.0)  # preload over one and two periods of the stroke
    elapsed_s: float = 0.0  # the axis has been running for so long
    sensors: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Recording:
    columns: dict[str, Array]
    truth: dict[str, Any]

    def write_csv(self, path: Path) -> Path:
        """In full precision."""
        with Path(path).open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(self.columns)
            for row in zip(*(each.tolist() for each in self.columns.values()), strict=True):
                rows.writerow([f"{value:.12g}" for value in row])
        return Path(path)


def led_in(setpoint_m: Array) -> tuple[Array, int]:
    """Approach the start in the positive direction and rest, as homing did."""
    n = round(LEAD_IN_S / 1e-3)
    t = np.clip((np.arange(n) * 1e-3 - 0.2) / 0.8, 0.0, 1.0)
    smooth = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    return np.concatenate([setpoint_m[0] - LEAD_IN_M * (1.0 - smooth), setpoint_m]), n


def planned(case: Case) -> Plan:
    rng = np.random.default_rng([case.seed, 3])
    axis = np.random.default_rng([case.axis_seed, 5])
    plan = plan_axis(case.machine, case.setpoint_m, case.axis_seed)
    plan.elapsed_s = case.elapsed_s
    plan.sensors = replace(plan.sensors, **case.sensors)
    plan.drive |= {"map_1": case.stroke_map[0], "map_2": case.stroke_map[1]}
    plan.drive |= {"map_1_phase": axis.uniform(0, 6.28), "map_2_phase": axis.uniform(0, 6.28)}
    fresh = case.machine.preload_percent
    percent = ageing.preload_trajectory(
        fresh if case.preload is None else case.preload, plan.slow_time_s
    )
    plan.slow["preload_n"] = percent / 100.0 * case.machine.dynamic_load_rating_n
    for event in case.events:
        ageing.apply(plan, event, rng)
    for name, strength in case.effects:
        own = np.random.default_rng([case.axis_seed, zlib.crc32(name.encode())])
        plan.truth.setdefault("effects", {})[name] = ALL[name](plan, own, strength)
    return plan


def simulate(case: Case) -> Recording:
    """Run a case; the same case gives the same numbers."""
    plan = planned(case)
    setpoint, lead_in = led_in(plan.setpoint_m)
    speed = np.gradient(setpoint, 1e-3)
    feed = np.column_stack([speed, np.gradient(speed, 1e-3)])
    push = np.concatenate([np.zeros(lead_in), plan.push_n])
    states, forces, energy = run(
        Drive(**{name: float(value) for name, value in plan.drive.items()}),
        substeps(plan.drive, float(plan.slow["table_kg"].min())),
        lead_in,
        setpoint,
        feed,
        plan.slow_table(),
        push,
        plan.growth_m,
        plan.walk_m,
        plan.rub_n,
        plan.waves_table("ripple"),
        plan.waves_table("lead"),
        plan.waves_table("disc"),
        plan.waves_table("rev"),
    )
    if not np.isfinite(states).all():
        raise FloatingPointError("the plant left the finite numbers")
    home(plan, states, lead_in)
    states, forces = states[lead_in:], forces[lead_in:]
    columns = record(states, plan.setpoint_m, temperature(plan, case.seed), plan.sensors, case.seed)
    for edit in plan.record:
        edit(columns)
    return Recording(columns, truth_of(plan, states, forces, energy))


def home(plan: Plan, states: Array, lead_in: int) -> None:
    """The encoders agree where the axis was homed: cold, after a positive approach."""
    last = states[lead_in - 100 : lead_in]
    x = float(last[:, 2].mean())
    nodes = np.linspace(0.0, plan.machine.stroke_m, plan.growth_m.shape[1])
    known = float(np.interp(x, nodes, plan.growth_m[0] + plan.walk_m))
    states[:, 0] += (
        x - known - plan.machine.lead_rad * float(last[:, 0].mean())
    ) / plan.machine.lead_rad


def temperature(plan: Plan, seed: int) -> Array:
    """Housing temperature at 1 kHz: ambient with a slow swing, plus what warming gave."""
    rng = np.random.default_rng([seed, 17])
    time_s = np.arange(plan.samples) * 1e-3
    ambient = 21.0 + 0.3 * np.sin(2 * np.pi * time_s / 2400.0 + rng.uniform(0, 6.28))
    rise = plan.truth.get("housing_rise_k")
    return ambient if rise is None else ambient + np.interp(time_s, plan.slow_time_s, rise)


def truth_of(plan: Plan, states: Array, forces: Array, energy: Array) -> dict[str, Any]:
    """Trajectories every 0.1 s, and the true signals at 1 kHz."""
    percent = 100.0 * plan.slow["preload_n"] / plan.machine.dynamic_load_rating_n
    names = (
        "nut_force_n",
        "coupling_nm",
        "nut_friction_nm",
        "guide_friction_n",
        "bearing_friction_nm",
        "applied_nm",
    )
    return plan.truth | {
        "time_s": plan.slow_time_s[::10],
        "preload_percent": percent[::10],
        "states": states,
        "forces": dict(zip(names, forces.T, strict=True)),
        "energy": energy,
    }
