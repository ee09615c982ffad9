"""Changes of a healthy axis in time: preload, warmth, payload, lubricant, cutting force."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .plan import NODES, SLOW_STEP_S, Plan

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Ramp:
    """Preload in percent: constant to `begin_s`, straight to `end_s`, constant after."""

    first: float
    last: float
    begin_s: float = 0.0
    end_s: float = np.inf  # the end of the run


@dataclass(frozen=True, slots=True)
class Steps:
    """Preload in percent: `first`, then each (time_s, percent)."""

    first: float
    changes: tuple[tuple[float, float], ...] = ()


PreloadSpec = float | Ramp | Steps | tuple[Array, Array]


def preload_trajectory(spec: PreloadSpec, time_s: Array) -> Array:
    """Percent at each slow time; (times, percents) are joined by lines."""
    if isinstance(spec, Ramp):
        end = min(spec.end_s, float(time_s[-1]))
        return np.interp(time_s, [spec.begin_s, end], [spec.first, spec.last])
    if isinstance(spec, Steps):
        percent = np.full(len(time_s), spec.first)
        for at, value in spec.changes:
            percent[time_s >= at] = value
        return percent
    if isinstance(spec, tuple):
        return np.interp(time_s, spec[0], spec[1])
    return np.full(len(time_s), float(spec))


@dataclass(frozen=True, slots=True)
class Warmup:
    """Friction is less once warm; time constants of its parts spread about `time_constant_s`."""

    time_constant_s: float = 600.0
    growth_m: float = 40e-6  # of the screw at the end of the stroke when warm
    housing_rise_k: float = 8.0
    start: float = 0.0  # 0 cold, 1 warm


@dataclass(frozen=True, slots=True)
class Payload:
    """(time_s, added kg) for each change; the mass stands from then on."""

    changes: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Relubrication:
    """Fresh lubricant: friction falls within 3 s of motion; preload stays."""

    time_s: float
    guide_drop: float = 0.25
    nut_drop: float = 0.25


@dataclass(frozen=True, slots=True)
class Lubricant:
    """Lubrication of each part in this session, as a factor of its friction."""

    guide: float = 1.0
    nut: float = 1.0
    bearing: float = 1.0
    viscous: float = 1.0


@dataclass(frozen=True, slots=True)
class ProcessForce:
    """Cuts: bursts of `mean_n` against the motion or across it, with tooth ripple."""

    mean_n: float = 250.0
    ripple_share: float = 0.4
    tooth_hz: float = 33.0
    duty: float = 0.3
    against_motion: float = 0.7  # share of the bursts; the others push one way
    bursts: tuple[tuple[float, float, float], ...] = ()  # (start_s, duration_s, N); empty: random


Event = Warmup | Payload | Relubrication | Lubricant | ProcessForce


def warmth(activity: Array, time_constant_s: float, start: float = 0.0) -> Array:
    """First-order heat balance fed by activity (k,), about one when warm."""
    keep = float(np.exp(-SLOW_STEP_S / time_constant_s))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], activity, zi=[keep * start])[0])


def activity(plan: Plan) -> Array:
    speed = plan.slow_speed_m_s()
    return speed / max(float(speed.mean()), 1e-6)


def grow(plan: Plan, end_m: float, slow_s: float = 900.0, start: float = 0.0) -> Array:
    """Growth (seconds, NODES) by heat diffusion along the screw from nut and fixed bearing.

    `end_m` is the growth at the stroke's end in the steady state of this motion.
    """
    duration = int(np.ceil(plan.samples / 1000.0)) + 2
    dx = plan.machine.stroke_m / (NODES - 1)
    x = np.linspace(0.0, plan.machine.stroke_m, NODES)
    speed, place = np.abs(plan.speed_m_s), plan.setpoint_m
    source = np.zeros((duration, NODES))
    for second in range(duration):
        part = slice(second * 1000, (second + 1) * 1000)
        if len(speed[part]):
            counts = np.histogram(
                place[part], NODES, (0, plan.machine.stroke_m), weights=speed[part]
            )[0]
            source[second] = counts + 0.4 * speed[part].sum() * np.exp(-x / 0.05) / 5.0
    mean = np.convolve(source.mean(axis=0), np.ones(9) / 9, mode="same")
    temperature = start * mean * slow_s
    profile = np.empty((duration, NODES))
    for second in range(duration):
        profile[second] = np.concatenate(
            [[0.0], np.cumsum(0.5 * (temperature[1:] + temperature[:-1]))]
        )
        bend = np.zeros(NODES)
        bend[1:-1] = np.diff(temperature, 2)
        bend[0], bend[-1] = temperature[1] - temperature[0], temperature[-2] - temperature[-1]
        temperature = temperature + 1.2e-5 / dx**2 * bend + source[second] - temperature / slow_s
    steady = slow_s * float(np.sum(mean))
    return profile * end_m / max(steady, 1e-12)


def warm_up(plan: Plan, spec: Warmup, rng: np.random.Generator) -> None:
    active = activity(plan)
    for part in ("guide", "bearing", "nut", "viscous"):
        own = spec.time_constant_s * float(np.exp(rng.uniform(-0.4, 0.4)))
        warm = np.minimum(warmth(active, own, spec.start), 1.15)
        share = np.exp(np.log1p(-0.4) * warm) if part == "viscous" else 1.0 - 0.3 * warm
        plan.slow[part] *= np.clip(share, 0.2, 1.5)
    plan.growth_m = plan.growth_m[:1] + grow(
        plan, spec.growth_m, 1.5 * spec.time_constant_s, spec.start
    )
    housing = warmth(warmth(active, spec.time_constant_s, spec.start), 400.0, spec.start)
    plan.truth["housing_rise_k"] = spec.housing_rise_k * housing


def load(plan: Plan, spec: Payload) -> None:
    for at, kg in spec.changes:
        plan.slow["table_kg"][plan.slow_time_s >= at] += kg


def relubricate(plan: Plan, spec: Relubrication) -> None:
    moving = np.cumsum(plan.slow_speed_m_s() > 1e-3) * SLOW_STEP_S
    after = moving - np.interp(spec.time_s, plan.slow_time_s, moving)
    worked_in = np.where(
        plan.slow_time_s >= spec.time_s, -np.expm1(-np.maximum(after, 0.0) / 3.0), 0.0
    )
    plan.slow["guide"] *= 1.0 - spec.guide_drop * worked_in
    plan.slow["nut"] *= 1.0 - spec.nut_drop * worked_in
    plan.slow["viscous"] *= 1.0 + 0.1 * worked_in


def cut(plan: Plan, spec: ProcessForce, rng: np.random.Generator) -> None:
    """Cutting force at 1 kHz: bursts with a rising edge, a mean and a tooth ripple."""
    bursts = list(spec.bursts)
    end, at = plan.samples * 1e-3, float(rng.uniform(2.0, 6.0))
    while not spec.bursts and at < end:
        length = float(rng.uniform(0.5, 3.0))
        bursts.append((at, length, spec.mean_n * float(rng.uniform(0.4, 1.6))))
        at += length / spec.duty * float(rng.uniform(0.6, 1.4))
    time_s = np.arange(plan.samples) * 1e-3
    speed = plan.speed_m_s
    for start, length, mean in bursts:
        into = (time_s >= start) & (time_s < start + length)
        edge = -np.expm1(-(time_s[into] - start) / 0.02)
        tooth = 1.0 + spec.ripple_share * np.sin(
            2 * np.pi * spec.tooth_hz * time_s[into] + rng.uniform(0, 6.28)
        )
        way = (
            -np.tanh(speed[into] / 0.002)
            if rng.random() < spec.against_motion
            else rng.choice([-1.0, 1.0])
        )
        plan.push_n[into] += mean * edge * tooth * way


def apply(plan: Plan, event: Event, rng: np.random.Generator) -> None:
    if isinstance(event, Warmup):
        warm_up(plan, event, rng)
    elif isinstance(event, Payload):
        load(plan, event)
    elif isinstance(event, Relubrication):
        relubricate(plan, event)
    elif isinstance(event, Lubricant):
        for part in ("guide", "nut", "bearing", "viscous"):
            plan.slow[part] *= getattr(event, part)
    else:
        cut(plan, event, rng)
