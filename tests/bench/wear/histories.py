"""Histories of a wearing screw by several laws, as a shop would measure its drag."""

from typing import Literal, get_args

import numpy as np

from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.wear import WearTest

Law = Literal["linear", "run-in", "accelerating", "decelerating", "stepwise", "wandering", "none"]
LAWS: tuple[Law, ...] = get_args(Law)
WEARING = tuple(law for law in LAWS if law != "none")
STAGE_H = 35.0
_COUNT = 150
_FRESH_NM = 0.5
_LOSS_AT_ONE = 0.2
_BY_TIME_SHARE = 0.2


def loss(law: Law, age: Floats, rng: np.random.Generator) -> Floats:
    """Wear at ages (n,), about 1 at age 1; rising.

    Running in follows an exponential, which is none of the shapes that the trend knows; steps are
    a compound Poisson process on top of slow wear; `wandering` is a rate that walks at random.
    """
    worn: Floats = np.zeros_like(age)
    match law:
        case "linear":
            worn = age
        case "run-in":
            share, length = rng.uniform(0.2, 0.5), rng.uniform(0.03, 0.15)
            worn = share * -np.expm1(-age / length) + (1.0 - share) * age
        case "accelerating":
            worn = age ** rng.uniform(1.3, 2.2)
        case "decelerating":
            worn = age ** rng.uniform(0.5, 0.8)
        case "stepwise":
            per_age = int(rng.integers(6, 16))
            count = int(per_age * age[-1]) + 1
            at, height = rng.uniform(0.0, age[-1], count), rng.exponential(1.0 / per_age, count)
            worn = 0.3 * age + 0.7 * ((age[:, None] >= at) @ height)
        case "wandering":
            rate = np.exp(np.clip(np.cumsum(0.12 * rng.standard_normal(age.size)), -1.2, 1.2))
            worn = np.cumsum(rate * np.gradient(age))
            worn -= worn[0]
        case "none":
            pass
    return worn


def history(law: Law, rng: np.random.Generator, count: int = _COUNT) -> WearTest:
    """Readings of one screw that has lost a fifth after 14 to 60 stages, and wears on.

    Most wear by the way, some by the hour. Readings scatter; lubrication drifts over some stages;
    what runs faster is warmer, and rubs less.
    """
    stage = np.arange(count, dtype=np.float64)
    speed = _speed(stage, rng)
    way = np.concatenate([[0.0], np.cumsum(speed)[:-1]])
    worn_by = stage if rng.random() < _BY_TIME_SHARE else way
    fifth = np.interp(rng.integers(14, 60), stage, worn_by)
    fallen = _LOSS_AT_ONE * loss(law, worn_by / fifth, rng)
    warmth = -0.01 * rng.uniform(0.0, 1.0) * np.log(speed / speed[0])
    scatter = rng.uniform(0.003, 0.015) * rng.standard_normal(count)
    drift = rng.uniform(0.003, 0.015) * _drift(count, rng.uniform(2.0, 8.0), rng)
    drag_nm = _FRESH_NM * np.maximum(1.0 - fallen, 0.05) * (1.0 + warmth + scatter + drift)
    return WearTest(STAGE_H * stage, 8400.0 * way, drag_nm)


def _speed(stage: Floats, rng: np.random.Generator) -> Floats:
    """Mean speed of each stage against the first: constant, raised by steps, or varying."""
    use = rng.choice(["constant", "rising", "varying"])
    if use == "constant":
        return np.ones_like(stage)
    if use == "rising":
        return np.asarray(1.0 + rng.uniform(0.2, 0.8) * (stage // 4))
    walk = np.clip(np.cumsum(0.1 * rng.standard_normal(stage.size)), -0.7, 0.7)
    return np.asarray(np.exp(walk + 0.3 * rng.standard_normal(stage.size)))


def _drift(count: int, memory: float, rng: np.random.Generator) -> Floats:
    """Ornstein-Uhlenbeck process of unit variance, (count,)."""
    kept = np.exp(-1.0 / memory)
    values = rng.standard_normal(count)
    for k in range(1, count):
        values[k] = kept * values[k - 1] + np.sqrt(1.0 - kept**2) * values[k]
    return values
