"""Shifts of healthy production: warm-up, new lubricant, payload, process force and pauses.

Unless a course is given the preload never changes in them, so every WARNING or FAULT is false.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from edge_service.messages.features import PHASES, Fault, FeatureBlock
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine

from .... import foreign_plant as plant
from ...life.plants import TIME_CONSTANT_S, WARM_SHARE
from ..axis import RATE_HZ, OwnAxis
from ..plants.foreign import commissioned_machine, recorded
from ..scores import Recorded

SHIFT_S = 600.0
PLANTS = ("own", "foreign", "own, one encoder", "foreign, one encoder")
Pauses = tuple[tuple[float, float], ...]
Course = tuple[tuple[float, float], ...]
"""Preload over the fresh one at some times: (s, share), straight between them."""
HEALTHY: Course = ((0.0, 1.0),)


@dataclass(frozen=True, slots=True)
class Shift:
    """One run of production on a healthy axis."""

    axis_seed: int
    seed: int
    duration_s: float
    warmth: float  # at its start, 0 cold, 1 warm
    # relubricated_s, relubricated: when, and the nut's and guides' friction after it
    relubricated_s: float
    relubricated: float
    payload: tuple[tuple[float, float], ...]  # (time s, added kg) of each change
    # force_n, force_duty: of process forces, and the share of the time with them
    force_n: float
    force_duty: float
    pauses: Pauses  # (time s, standstill s)


def draw_shift(axis_seed: int, duration_s: float) -> Shift:
    """A shift; the same arguments give the same shift. Each event happens in half of them."""
    rng = np.random.default_rng([axis_seed, 41])

    def when(count: int) -> list[float]:
        return sorted(float(at) for at in rng.uniform(0.1, 0.9, count) * duration_s)

    changes = [(at, float(rng.choice([5.0, 10.0]))) for at in when(int(rng.integers(0, 3)))]
    if len(changes) > 1:  # what is put on is taken off by the next one
        changes[1] = (changes[1][0], -changes[0][1])
    forces = rng.random() < 0.5
    return Shift(
        axis_seed=axis_seed,
        seed=int(rng.integers(1, 2**31)),
        duration_s=duration_s,
        warmth=0.0 if rng.random() < 0.5 else float(rng.uniform(0.3, 1.0)),
        relubricated_s=when(1)[0],
        relubricated=1.0 if rng.random() < 0.5 else float(rng.uniform(0.75, 0.9)),
        payload=tuple(changes),
        force_n=float(rng.uniform(100.0, 400.0)) if forces else 0.0,
        force_duty=float(rng.uniform(0.1, 0.35)),
        pauses=tuple((at, float(rng.uniform(5.0, 60.0))) for at in when(int(rng.integers(0, 4)))),
    )


def produced(
    plant: str, axis_seed: int, duration_s: float, course: Course = HEALTHY
) -> tuple[Machine, Recorded]:
    """Commissioned machine file and recording of a drawn shift on one of `PLANTS`."""
    name, _, lacking = plant.partition(", ")
    blind, shift = bool(lacking), draw_shift(axis_seed, duration_s)
    if name == "own":
        axis = OwnAxis(axis_seed)
        machine = replace(axis, one_encoder=blind).commissioned()
        made = _own(shift, axis, course)
    else:
        machine = commissioned_machine(axis_seed, one_encoder=blind)
        made = foreign_shift(shift, course)
    if blind:
        made = replace(made, blocks=[without_table(block) for block in made.blocks])
    return machine, made


def without_table(block: FeatureBlock) -> FeatureBlock:
    """As the downsampler says it when the linear encoder is missing."""
    phases = {name: replace(getattr(block, name), table_m=math.nan) for name in PHASES}
    return replace(block, fault=block.fault | Fault.NO_TABLE, **phases)


def foreign_shift(shift: Shift, course: Course) -> Recorded:
    after = 1.0 - shift.relubricated
    events: list[Any] = [
        plant.Warmup(time_constant_s=TIME_CONSTANT_S, start=shift.warmth),
        plant.Relubrication(shift.relubricated_s, after, after),
        plant.Payload(shift.payload),
    ]
    if shift.force_n:
        events.append(plant.ProcessForce(shift.force_n, duty=shift.force_duty))
    rng = np.random.default_rng([shift.seed, 43])
    times_s, shares = np.array(course).T
    case = plant.axis_case(
        (times_s, plant.Machine().preload_percent * shares),
        setpoint_m=plant.part_programme(rng, shift.duration_s, pauses=shift.pauses),
        events=tuple(events),
        seed=shift.seed,
        axis_seed=shift.axis_seed,
    )
    return recorded(case)


def _own(shift: Shift, axis: OwnAxis, course: Course) -> Recorded:
    """On the library's plant; it pauses where its part program would go on."""
    count = round(shift.duration_s * RATE_HZ)
    time_s = np.arange(count) / RATE_HZ
    machine = axis.commissioned()
    assert machine.commissioned is not None
    faded_nm = WARM_SHARE * machine.commissioned.coulomb_nm
    effects = (
        f"drag_error:change_nm={-faded_nm}",
        f"warmup:excess_nm={faded_nm * (1.0 - shift.warmth)},time_constant_s={TIME_CONSTANT_S}",
    )
    added = np.zeros(count)
    for at_s, kg in shift.payload:
        added[time_s >= at_s] += kg
    percent = axis.fresh_percent * np.interp(time_s, *np.array(course).T)
    return axis.produced(
        percent,
        shift.seed,
        effects,
        np.where(time_s >= shift.relubricated_s, shift.relubricated, 1.0),
        pauses=shift.pauses,
        added_mass_kg=added,
        external_force_n=_bursts(shift, count),
    )


def _bursts(shift: Shift, count: int) -> Floats:
    """Process force (n,), N: bursts of .5 to 3 s, one way each."""
    force, rng = np.zeros(count), np.random.default_rng([shift.seed, 47])
    if shift.force_n:
        for first, last in pairwise(_edges(shift, rng)):
            busy = first + (last - first) * shift.force_duty
            rows = slice(round(first * RATE_HZ), round(busy * RATE_HZ))
            force[rows] = shift.force_n * rng.uniform(0.4, 1.6) * rng.choice([-1.0, 1.0])
    return force


def _edges(shift: Shift, rng: np.random.Generator) -> Iterator[float]:
    at_s = 2.0
    while at_s < shift.duration_s:
        yield at_s
        at_s += rng.uniform(0.5, 3.0) / shift.force_duty
