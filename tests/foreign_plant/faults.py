"""Faults that an axis can have: the effects of a library, each written in its own way.

A fault edits a plan and returns its true parameters. Strength 1 is a typical case.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from .ageing import ProcessForce, activity, cut, grow, warmth
from .plan import NODES, Plan, damping

Draw = np.random.Generator
Cause = Callable[[Plan, Draw, float], dict[str, Any]]
TORQUE, TRANSMISSION, BOTH = "torque_nm", "transmission_m", "both"


@dataclass(frozen=True, slots=True)
class Fault:
    """`channel`: where it shows on a stiff axis."""

    cause: Cause
    channel: str

    def __call__(self, plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
        return {"strength": strength} | self.cause(plan, rng, strength)


def sign(rng: Draw, positive: float = 0.5) -> float:
    return 1.0 if rng.random() < positive else -1.0


def needed_nm(plan: Plan) -> NDArray[np.float64]:
    """Torque (n,) that the nominal axis needs for this motion."""
    machine, speed = plan.machine, plan.speed_m_s / plan.machine.lead_rad
    smooth = machine.inertia_kg_m2 * np.gradient(speed, 1e-3) + machine.viscous_nm_s_per_rad * speed
    return np.abs(smooth + machine.coulomb_nm * np.sign(speed))


def table_mass(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    added = plan.machine.table_mass_kg * rng.uniform(0.8, 1.5) * strength
    plan.slow["table_kg"] += added
    return {"added_kg": added, "change_kg_m2": added * plan.machine.lead_rad**2}


def stiff_grease(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    share = rng.uniform(0.4, 0.9) * strength
    plan.slow["viscous"] *= 1.0 + share
    return {"share": share, "change_nm_s_per_rad": share * plan.machine.viscous_nm_s_per_rad}


def drag_level(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Less: the nut loses preload, then the guides run easier. More: seals and bearings rub."""
    change = sign(rng, 0.4) * plan.machine.coulomb_nm * min(rng.uniform(0.28, 0.5) * strength, 0.8)
    if change > 0.0:
        plan.scale(bearing_c=1.0 + 0.5 * change / plan.drive["bearing_c"])
        plan.scale(guide_c=1.0 + 0.5 * change / plan.drive["guide_c"] / plan.machine.lead_rad)
    else:
        nut = min(-change, 0.9 * plan.machine.preload_drag_nm)
        plan.slow["preload_n"] *= 1.0 - nut / plan.machine.preload_drag_nm
        guide = plan.drive["guide_c"] * plan.machine.lead_rad
        plan.scale(guide_c=1.0 + (change + nut) / guide if -change - nut < 0.9 * guide else 0.1)
    return {"change_nm": change}


def magnets(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    share = sign(rng, 0.3) * rng.uniform(0.1, 0.22) * strength
    plan.drive["gain"] *= max(1.0 + share, 0.3)
    return {"applied_share": share}


def thin_film(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Breakaway above the kinetic level, fading as exp(-|v|/vs) in one of the three bodies."""
    excess = rng.uniform(0.2, 0.4) * strength
    speed = float(np.exp(rng.uniform(np.log(0.6), np.log(4.0))))
    part = str(rng.choice(["guide", "nut", "bearing"]))
    lever = plan.machine.lead_rad
    level = {
        "guide": plan.drive["guide_c"] * lever,
        "nut": plan.machine.preload_drag_nm,
        "bearing": plan.drive["bearing_c"],
    }[part]
    plan.drive[f"{part}_excess"] += excess / level
    plan.drive[f"{part}_vs"] = speed * (lever if part == "guide" else 1.0)
    return {"excess_nm": excess, "speed_rad_s": speed, "part": part}


def one_sided(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    kind = str(rng.choice(["tilt", "offset", "asymmetry"]))
    size = sign(rng) * rng.uniform(0.1, 0.2) * strength
    if kind == "tilt":
        plan.drive["tilt_n"] += size / plan.machine.lead_rad
    elif kind == "offset":
        plan.drive["torque_offset"] -= size
    else:
        most = 0.9 * plan.machine.preload_drag_nm  # with more, less drag one way is another level
        plan.drive["asymmetry"] += float(np.clip(size, -most, most)) / plan.machine.coulomb_nm
    return {"kind": kind, "nm": size}


def soft_bristles(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    reach = rng.uniform(10e-6, 30e-6) * strength
    plan.drive["guide_reach"] = reach
    plan.drive["nut_reach"] = plan.drive["bearing_reach"] = reach / plan.machine.lead_rad
    return {"reach_m": reach}


def rough_stretch(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """A raised-cosine hill on the guide with a random texture over it."""
    peak = rng.uniform(0.2, 0.4) * strength / plan.machine.lead_rad
    width, centre = rng.uniform(0.05, 0.25), rng.uniform(0.25, 0.75) * plan.machine.stroke_m
    x = np.linspace(0.0, plan.machine.stroke_m, NODES)
    hill = np.where(abs(x - centre) < width, np.cos(0.5 * np.pi * (x - centre) / width) ** 2, 0.0)
    texture = gaussian_filter1d(rng.standard_normal(NODES), 2.0)
    plan.rub_n += peak * hill * (1.0 + 0.25 * texture)
    return {"peak_nm": peak * plan.machine.lead_rad, "centre_m": centre, "half_width_m": width}


def soft_train(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    part = str(rng.choice(["coupling", "bearing", "shaft"]))
    twist = rng.uniform(250.0, 500.0) / strength
    line = twist / plan.machine.lead_rad**2
    if part == "coupling":
        plan.drive["coupling_k"] = twist
    elif part == "bearing":
        plan.drive["bearing_k"] = line
    else:
        plan.drive |= {"bearing_k": 2.0 * line, "shaft_ae": line, "shaft_gj": 656.0}
    plan.drive |= damping(plan.drive, plan.machine.table_mass_kg, stiff=False)
    return {"part": part, "stiffness_nm_per_rad": twist}


def worn_nut(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    plan.drive["play"] = rng.uniform(6e-6, 18e-6) * strength
    return {"width_m": plan.drive["play"]}


def bad_lead(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    kind = str(rng.choice(["wobble", "cumulative", "both"]))
    wobble = rng.uniform(1.5e-6, 3.5e-6) * strength
    slope = sign(rng) * rng.uniform(15e-6, 40e-6) * strength
    if kind != "cumulative":
        for order, share in ((1.0, 1.0), (2.0, 0.3)):
            plan.waves["lead"].append((order, share * wobble, rng.uniform(0, 6.28), 1e9))
    if kind != "wobble":
        x = np.linspace(0.0, plan.machine.stroke_m, NODES)
        steps = gaussian_filter1d(rng.standard_normal(NODES), 4.0) * slope * x[1]
        plan.walk_m += slope * x + np.cumsum(steps) - steps[0]
    return {"kind": kind, "amplitude_m": wobble, "slope": slope}


def hot_screw(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    rise = rng.uniform(2.5, 6.0) * strength
    slow_s = rng.uniform(25.0, 100.0)
    start = -float(np.expm1(-plan.elapsed_s / slow_s))
    end = 11.5e-6 * rise * plan.machine.stroke_m
    plan.growth_m = plan.growth_m[:1] + grow(plan, end, slow_s, start)
    warm = warmth(activity(plan), slow_s, start)
    plan.truth["housing_rise_k"] = rise * warmth(warm, 0.3 * slow_s, start)
    return {"rise_k": rise, "time_constant_s": slow_s}


def cogging(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    order, size = float(rng.choice([4, 6, 8, 12, 16])), rng.uniform(0.08, 0.16) * strength
    for each, share in ((order, 1.0), (2 * order, 0.3), (order / 2, 0.15)):
        wave = each, share * size, rng.uniform(0, 6.28), rng.uniform(40, 200)
        plan.waves["ripple"].append(wave)
    return {"order": order, "amplitude_nm": size}


def disc_off_centre(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    size = rng.uniform(0.4e-3, 0.9e-3) * strength
    for order, share in ((1.0, 1.0), (2.0, 0.15)):
        plan.waves["disc"].append((order, share * size, rng.uniform(0, 6.28), 1e9))
    return {"amplitude_rad": size}


def slow_current(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """A queue and a lag; whoever commissioned the drive turned its gains down for it."""
    total = min(rng.uniform(1.2e-3, 2.8e-3) * strength, 8e-3)
    share = rng.uniform(0.3, 0.6)
    plan.drive["queue"] = min(share * total / 125e-6, 60.0)
    plan.drive["lag"] += (1.0 - share) * total
    softer, slower = 1.0 / (1.0 + total / 1.5e-3), 1.0 / (1.0 + total / 4e-3)
    plan.scale(kp=softer, ti=1.0 + total / 1e-3, kv=slower)
    return {"lag_s": total}


def late_scale(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    skew = sign(rng, 0.8) * float(np.exp(rng.uniform(np.log(3e-5), np.log(3e-4)))) * strength
    plan.sensors.skew_s += skew
    return {"skew_s": skew}


def cold_start(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    """Friction above the stated one that eases as motion heats the lubricant."""
    excess = rng.uniform(0.3, 0.55) * strength
    tau = rng.uniform(20.0, 90.0)
    start = -float(np.expm1(-plan.elapsed_s / tau))
    warm = warmth(activity(plan), tau, start)
    for part, share in (("guide", 1.0), ("nut", 0.8), ("bearing", 1.2), ("viscous", 0.6)):
        plan.slow[part] *= 1.0 + share * excess * np.exp(-2.0 * np.maximum(warm, 0.0))
    plan.truth["housing_rise_k"] = rng.uniform(2, 6) * warmth(warm, 0.5 * tau, start)
    return {"excess_share": excess, "time_constant_s": tau}


def milling(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    end = plan.samples * 1e-3
    count = int(rng.integers(3, 7))
    starts = np.sort(rng.uniform(0.05, 0.9, count)) * end
    draw = rng.uniform
    bursts = tuple((float(at), draw(1.5, 4.0), draw(150, 350) * strength) for at in starts)
    cut(plan, ProcessForce(tooth_hz=rng.uniform(15, 45), against_motion=0.3, bursts=bursts), rng)
    return {"bursts": bursts}


def poor_efficiency(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    coefficient = rng.uniform(0.15, 0.3) * strength
    plan.drive["load_mu"] = coefficient * plan.machine.lead_rad
    return {"coefficient": coefficient}


def churned_grease(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    plan.drive["churn"] = rng.uniform(0.15, 0.4) * strength
    plan.drive["churn_power"] = rng.uniform(1.7, 2.3)
    return {"nm_at_100_rad_s": plan.drive["churn"], "power": plan.drive["churn_power"]}


def bent_screw(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    size = min(rng.uniform(0.08, 0.13) * strength, 0.9 * plan.machine.preload_drag_nm)
    plan.waves["rev"].append((1.0, size, rng.uniform(0, 6.28), 1e9))
    plan.waves["rev"].append((2.0, 0.2 * size, rng.uniform(0, 6.28), 1e9))
    return {"amplitude_nm": size}


def current_limit(plan: Plan, rng: Draw, strength: float) -> dict[str, Any]:
    need = needed_nm(plan)
    limit = float(need.max() * np.clip(rng.uniform(0.9, 0.96) - 0.1 * strength, 0.68, 0.95))
    plan.drive |= {"applied_limit": limit, "torque_max": 1.4 * limit}
    plan.drive |= {"integral_max": 1.5 * plan.machine.coulomb_nm, "kv": 25.0}
    return {"limit_nm": plan.drive["applied_limit"]}


FAULTS: dict[str, Fault] = {
    "inertia_error": Fault(table_mass, TORQUE),
    "viscous_error": Fault(stiff_grease, TORQUE),
    "drag_error": Fault(drag_level, TORQUE),
    "torque_gain_error": Fault(magnets, TORQUE),
    "stribeck": Fault(thin_film, TORQUE),
    "load_offset": Fault(one_sided, TORQUE),
    "presliding": Fault(soft_bristles, TORQUE),
    "position_friction": Fault(rough_stretch, TORQUE),
    "compliance": Fault(soft_train, TRANSMISSION),
    "backlash": Fault(worn_nut, TRANSMISSION),
    "lead_error": Fault(bad_lead, TRANSMISSION),
    "thermal_growth": Fault(hot_screw, TRANSMISSION),
    "torque_ripple": Fault(cogging, TORQUE),
    "encoder_eccentricity": Fault(disc_off_centre, TRANSMISSION),
    "delay": Fault(slow_current, TORQUE),
    "timestamp_skew": Fault(late_scale, TRANSMISSION),
    "warmup": Fault(cold_start, TORQUE),
    "external_force": Fault(milling, TORQUE),
    "load_friction": Fault(poor_efficiency, TORQUE),
    "quadratic_friction": Fault(churned_grease, TORQUE),
    "once_per_rev_friction": Fault(bent_screw, TORQUE),
    "saturation": Fault(current_limit, TORQUE),
}
