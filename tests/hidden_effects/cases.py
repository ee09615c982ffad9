"""Cases: the plants that record hidden effects, and which effects are hidden."""

import difflib
import importlib
import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.diagnose.session.session import rigid_plant
from edge_service.messages.samples import SampleFrame
from edge_service.models.effects.effect import ActiveEffect, Role
from edge_service.models.effects.learned import learned_effects
from edge_service.models.effects.registry import effect_names, get_effect, parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import motion_limits
from edge_service.offline.diagnosis.diagnose import library_without
from edge_service.offline.diagnosis.gap import DiagnosisError, one_line
from edge_service.offline.simulate import commanded_motion

STRENGTHS = (0.5, 1.0, 2.0)
"""Of a typical fault."""
RATE_HZ, PERCENT = 1000.0, 7.0
"""Of the own plant; its preload where the machine file has none."""
NONE = "none"
"""In place of an effect: every axis is healthy."""
FRESH, FRESH_S = "production", 60.0
"""Motion of the recording that shows how far the gap really shrinks, and its duration."""
SIZES = {"healthy": 0, "single": 1, "odd": 1, "out": 1, "pair": 2, "triple": 3}
"""Effects that a kind of case hides; the library has no entry for those of `odd` and `out`."""
_KINDS = ("healthy", "single", "single", "single", "pair", "odd", "out", "triple")


@dataclass(frozen=True, slots=True)
class HiddenCase:
    """Effects of one axis, by name or as NAME:KEY=VALUE,..., and what the library is to lack."""

    causes: tuple[str, ...]
    strength: float
    motion: str
    seed: int
    withheld: tuple[str, ...] = ()

    @property
    def names(self) -> set[str]:
        return {each.partition(":")[0] for each in self.causes}


@dataclass(frozen=True, slots=True)
class Plant:
    """Axis that records hidden effects."""

    machine_toml: str  # its machine file, which knows of none of them
    known: Sequence[str]  # names of effects that it can have, and the library too
    odd: Sequence[str]  # of those that the library lacks
    motions: Sequence[str]
    # recording of the axis of a case, on a motion, with a seed of its own
    recorded: Callable[[HiddenCase, str, int], SampleFrame]


def own_plant(machine_file: Path | None = None) -> Plant:
    """Simulated axis of a machine file, as stiff as its model, with effects of the library."""
    known = [name for name in effect_names() if not get_effect(name).is_fault]
    path = machine_file or DEFAULT_MACHINE
    recorded = partial(_own_recorded, load_machine(path))
    return Plant(path.read_text("utf-8"), known, (), ("friction", FRESH), recorded)


def _own_recorded(machine: Machine, case: HiddenCase, motion: str, seed: int) -> SampleFrame:
    duration_s, limits = FRESH_S if motion == FRESH else None, motion_limits(machine)
    percent, random = machine.fresh_preload_percent or PERCENT, np.random.default_rng(seed)
    with one_line():
        told = commanded_motion(motion, duration_s, limits, RATE_HZ, random)
        active = [*learned_effects(machine), *(_drawn(text, case) for text in case.causes)]
        settings = FeedDriveSettings.of_machine(machine, RATE_HZ, active)
    stiff = replace(settings, plant=rigid_plant(settings.plant))
    drive = FeedDrive(stiff, limits.low_m, percent, seed)
    return drive.advance(told.setpoints.take(told.count), np.full(told.count, percent))


def _drawn(text: str, case: HiddenCase) -> ActiveEffect:
    """Effect as it is given, or with amounts and phases by chance."""
    active = parse_effect(text)
    random = np.random.default_rng([case.seed, zlib.crc32(text.encode())])
    values = dict(active.values)
    for each in () if ":" in text else active.effect.parameters:
        if each.role is Role.AMOUNT:
            drawn = case.strength * random.uniform(0.8, 1.25) * each.faulty
            values[each.name] = min(max(drawn, each.low), each.high)
        elif each.role is Role.PHASE:
            values[each.name] = random.uniform(0.0, 2.0 * math.pi)
    return replace(active, values=values)


def foreign_plant() -> Plant:
    """Axis that shares no code with the library; its seed draws what its effects are."""
    plant = importlib.import_module("foreign_plant")
    return Plant(
        plant.nominal_machine_toml(plant.DIAGNOSIS),
        sorted(plant.FAULTS),
        sorted(plant.ODDITIES),
        ("full", FRESH, "staircase"),
        _foreign_recorded,
    )


def _foreign_recorded(case: HiddenCase, motion: str, seed: int) -> SampleFrame:
    plant = importlib.import_module("foreign_plant")
    there = tuple((name, case.strength) for name in case.causes)
    made = plant.case(there, motion, seed=seed, axis_seed=case.seed)
    columns = dict(plant.simulate(made).columns)
    return SampleFrame(columns.pop("time_s"), columns)


def plan(
    plant: Plant, count: int, seed: int, given: Sequence[str] = (), withheld: Sequence[str] = ()
) -> list[HiddenCase]:
    """Cases of given effects, or none; or healthy ones, singles, pairs, triples, what nobody knows.

    Args:
        withheld: what the library is to lack; of every eighth case it is the cause itself.

    Raises DiagnosisError: an effect or its values that the plant, or the library, does not know.
    """
    library_without(withheld)
    for text in given:
        _check_effect(plant, text)
    random, cases = np.random.default_rng(seed), list[HiddenCase]()
    for k in range(count):
        kind, motion = _KINDS[k % len(_KINDS)], plant.motions[k % len(plant.motions)]
        strength, number = float(random.choice(STRENGTHS)), seed * 10_000 + k
        strength = strength if SIZES[kind] else 1.0
        name, lacking = plant.known[(k // 2) % len(plant.known)], tuple(withheld)
        others = [str(each) for each in random.permutation(plant.known) if each != name]
        causes = () if NONE in given else tuple(given) or (name, *others)[: SIZES[kind]]
        if kind == "odd" and plant.odd and not given:
            causes = (str(random.choice(plant.odd)),)
        elif kind in ("odd", "out") and not given:
            strength, lacking = max(strength, 1.0), (*lacking, name)
        cases.append(HiddenCase(causes, strength, motion, number, lacking))
    return cases


def _check_effect(plant: Plant, text: str) -> None:
    name, stated, _ = text.partition(":")
    there = [*plant.known, *plant.odd, NONE]
    if name not in there:
        near = difflib.get_close_matches(name, there, 3)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise DiagnosisError(f"no effect {name!r}{hint}; the plant has {', '.join(there)}")
    if stated and plant.odd:
        raise DiagnosisError(f"--effect {text}: a foreign plant draws the values; name it only")
    if stated:
        with one_line():
            parse_effect(text)
