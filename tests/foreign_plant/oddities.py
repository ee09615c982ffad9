"""Causes that a library of effects does not hold; an honest diagnosis says `unknown`."""

from typing import Any

import numpy as np

from .faults import BOTH, FAULTS, TORQUE, TRANSMISSION, Draw, Fault, needed_nm
from .plan import Plan

Columns = dict[str, np.ndarray]


def wiper_drag(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Wipers bite while the table speeds up, and not while it slows down."""
    plan.drive["accel_drag"] = rng.uniform(0.06, 0.12) * strength
    return {"nm_s2_per_m": plan.drive["accel_drag"]}


def stuck_seal(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """After standing, a peak growing with the logarithm of the rest, fading over millimetres."""
    plan.drive["seal_n"] = rng.uniform(80, 160) * strength
    plan.drive["seal_reach"] = rng.uniform(2e-3, 8e-3)
    return {"n_per_decade": plan.drive["seal_n"], "reach_m": plan.drive["seal_reach"]}


def tired_magnets(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Torque weakens with the squared torque remembered over some seconds."""
    need = needed_nm(plan)
    plan.drive["fatigue"] = rng.uniform(0.25, 0.5) * strength / float(np.mean(need**2))
    plan.drive["fatigue_tau"] = rng.uniform(1.0, 4.0)
    return {"per_nm2": plan.drive["fatigue"], "memory_s": plan.drive["fatigue_tau"]}


def loaded_cogging(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Ripple in proportion to the torque whose phase wanders with the table's place."""
    plan.drive["load_cogging"] = min(rng.uniform(0.15, 0.3) * strength, 0.5)
    plan.drive["load_cogging_order"] = float(rng.choice([5, 7, 9, 11]))
    return {"share": plan.drive["load_cogging"], "order": plan.drive["load_cogging_order"]}


def crosstalk(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """The measured torque holds a share of another axis' accelerations, at times of its own."""
    n, at, other = plan.samples, 0, np.zeros(plan.samples)
    while at < n:
        length, size = int(rng.integers(60, 250)), rng.uniform(0.12, 0.35) * strength
        pulse = np.sin(np.linspace(0.0, 2 * np.pi, length)) * size * rng.choice([-1.0, 1.0])
        other[at : at + length] += pulse[: max(n - at, 0)][: len(other[at : at + length])]
        at += length + int(rng.integers(20, 900))

    def edit(columns: Columns) -> None:
        columns["torque_command_nm"] = columns["torque_command_nm"] + other

    plan.record.append(edit)
    return {"rms_nm": float(np.std(other))}


def loose_fixture(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """A workpiece rattles in its clamp: a second mass behind a gap."""
    mass = min(rng.uniform(6, 10) * strength, 0.7 * plan.machine.table_mass_kg)
    plan.slow["table_kg"] -= mass
    plan.drive |= {"loose_kg": mass, "loose_gap": rng.uniform(1e-3, 3e-3)}
    return {"kg": mass, "gap_m": plan.drive["loose_gap"]}


def interpolation(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """The linear encoder errs within each 20 um signal period."""
    size, phase = rng.uniform(0.3e-6, 0.6e-6) * strength, rng.uniform(0, 6.28)

    def edit(columns: Columns) -> None:
        x = columns["table_position_m"]
        turn = 2 * np.pi * x / 20e-6
        columns["table_position_m"] = x + size * (np.sin(turn + phase) + 0.4 * np.sin(2 * turn))

    plan.record.append(edit)
    return {"amplitude_m": size, "period_m": 20e-6}


def noise_bursts(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """A welder next door: bursts on torque and linear encoder."""
    size, n = rng.uniform(0.3, 0.7) * strength, plan.samples
    loud = np.zeros(n)
    at = int(rng.integers(0, 2000))
    while at < n:
        length = int(rng.integers(30, 250))
        loud[at : at + length] = 1.0
        at += length + int(rng.integers(200, 2500))
    hiss = np.convolve(rng.standard_normal(n), np.ones(12) / np.sqrt(12), mode="same")
    torque = loud * hiss * size
    linear = loud * rng.standard_normal(n) * 1e-6 * strength

    def edit(columns: Columns) -> None:
        columns["torque_command_nm"] = columns["torque_command_nm"] + torque
        columns["table_position_m"] = columns["table_position_m"] + linear

    plan.record.append(edit)
    return {"nm": size, "share_of_time": float(loud.mean())}


def cable_chain(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """A drag chain pulls back like a spring that slips after centimetres."""
    plan.drive["chain_n"] = rng.uniform(40, 80) * strength
    plan.drive["chain_reach"] = rng.uniform(0.05, 0.15)
    return {"n": plan.drive["chain_n"], "reach_m": plan.drive["chain_reach"]}


def grease_pulses(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Guides dry out between the pulses of a grease pump."""
    period = rng.uniform(8.0, 20.0)
    phase = (plan.slow_time_s / period + rng.random()) % 1.0
    size = rng.uniform(0.7, 1.2) * strength
    plan.slow["guide"] *= np.maximum(1.0 + size * (phase**2 - 1 / 3), 0.1)
    return {"period_s": period, "share": size}


def cover_plates(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Telescopic covers: each plate is picked up with a knock, elsewhere on the way back."""
    size, gap = rng.uniform(150, 300) * strength, rng.uniform(0.04, 0.09)
    knock = np.exp(-np.arange(150) / 35.0) * size
    for offset, way in ((0.0, 1.0), (0.4 * gap, -1.0)):
        plate = np.floor((plan.setpoint_m - offset) / gap)
        hits = np.flatnonzero(np.diff(plate) * way > 0)
        for hit in hits:
            part = plan.push_n[hit : hit + len(knock)]
            part -= way * knock[: len(part)]
    return {"n": size, "pitch_m": gap}


ODDITIES: dict[str, Fault] = {
    "wiper_drag": Fault(wiper_drag, TORQUE),
    "stuck_seal": Fault(stuck_seal, TORQUE),
    "tired_magnets": Fault(tired_magnets, TORQUE),
    "loaded_cogging": Fault(loaded_cogging, TORQUE),
    "crosstalk": Fault(crosstalk, TORQUE),
    "loose_fixture": Fault(loose_fixture, TORQUE),
    "interpolation": Fault(interpolation, TRANSMISSION),
    "noise_bursts": Fault(noise_bursts, BOTH),
    "cable_chain": Fault(cable_chain, TORQUE),
    "grease_pulses": Fault(grease_pulses, TORQUE),
    "cover_plates": Fault(cover_plates, TORQUE),
}
ALL: dict[str, Fault] = FAULTS | ODDITIES
