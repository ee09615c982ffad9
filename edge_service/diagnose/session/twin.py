"""Digital twin: a healthy simulated axis on the motion of a recording, and its baseline."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np

from ...messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from ...models.effects.baseline import Baseline
from ...models.effects.effect import ActiveEffect, Role, Term
from ...models.effects.learned import model_effects
from ...models.effects.registry import (
    active_effect,
    effects,
    error_of,
    get_effect,
)
from ...models.feed_drive import FeedDrive, FeedDriveSettings
from ...models.machine import DEFAULT_TOLERANCE, Machine
from ...models.plant.encoders import Sensors
from ...models.plant.two_mass import Plant
from .recordings import EDGE_S, Run, runs_of
from .session import Session

LONGEST_RUN_S = 60.0
"""Of each healthy run; the beginning of a longer recording stands for the rest."""
LONGEST_TWIN_S = 300.0
"""Of all runs of a twin together, about; runs spread over a longer session stand for the rest."""
_STIFFENING = 300.0
_SETTLE_S = 0.5
_PRELOAD_PERCENT = 7.0
_PHASES = 2
"""Drawn for the harmonics among the traces."""


def rigid_baseline(machine: Machine) -> Baseline:
    """Baseline as the machine file means it: nothing winds up."""
    baseline = Baseline.of_machine(machine)
    return replace(baseline, compliance_m_per_n=np.zeros_like(baseline.compliance_m_per_n))


def rigid_plant(plant: Plant) -> Plant:
    """Plant whose springs are too stiff to show."""
    return plant._replace(
        screw_rigidity_n=plant.screw_rigidity_n * _STIFFENING,
        nut_catalogue_n_per_m=plant.nut_catalogue_n_per_m * _STIFFENING,
        bearing_compliance_m_per_n=plant.bearing_compliance_m_per_n / _STIFFENING,
        further_compliance_m_per_n=plant.further_compliance_m_per_n / _STIFFENING,
        damping_n_s_per_m=plant.damping_n_s_per_m * np.sqrt(_STIFFENING),
    )


def parameter_tolerances(machine: Machine) -> dict[str, float]:
    """Standard deviation of each parameter effect's amount, as the machine file states it.

    How well the inertia is known says nothing of the torque's own scale.
    """
    model = machine.model
    drag = model.preload_drag_nm
    tolerances = {
        Term.INERTIA: model.inertia_kg_m2.sigma,
        Term.VISCOUS: model.viscous_nm_s_per_rad.sigma,
        Term.COULOMB: machine.other_drag_nm.sigma + (drag.sigma if drag else 0.0),
        Term.GAIN: min(model.inertia_kg_m2.tolerance, DEFAULT_TOLERANCE),
    }
    return {error_of(term): sigma for term, sigma in tolerances.items()}


def excerpt(runs: Sequence[Run]) -> list[Run]:
    """Runs that stand for all, in their order: each so-many-th of those that hold the same.

    Of every kind (what was recorded, and whether anything moves) one is kept at least.
    """
    simulated_s = sum(min(run.duration_s, LONGEST_RUN_S) for run in runs)
    every = max(math.ceil(simulated_s / LONGEST_TWIN_S), 1)
    seen: Counter[tuple[bool, ...]] = Counter()
    kept = []
    for run in runs:
        kind = run.has_torque, run.transmission_m is not None, bool(run.moving.any())
        if seen[kind] % every == 0:
            kept.append(run)
        seen[kind] += 1
    return kept


def healthy_session(machine: Machine, runs: Sequence[Run], seed: int) -> Session:
    """Healthy axis simulated on the motion of runs: drawn parameters, traces, measured noise."""
    random = np.random.default_rng((seed, 20))
    drawn = _drawn(machine, random)
    effects = (*model_effects(machine), *_traces(machine, random))
    baseline = rigid_baseline(machine)
    made: list[Run] = []
    for number, run in enumerate(excerpt(runs)):
        period_s = run.period_s
        settings = FeedDriveSettings.of_machine(drawn, 1.0 / period_s)
        plant = rigid_plant(settings.plant)
        sensors = Sensors(
            torque_noise_nm=run.noise.get(TORQUE, 0.0),
            angle_noise_rad=run.noise.get(ANGLE, 0.0),
            table_noise_m=run.noise.get(TABLE_POSITION, 0.0),
            angle_step_rad=0.0,
            table_step_m=0.0,
        )
        settings = replace(settings, plant=plant, effects=effects, sensors=sensors)
        position = run.setpoint_m
        if position is None:
            position = plant.ratio_m_per_rad * run.motion.angle_rad
        position = position[: min(len(run.motion), round(LONGEST_RUN_S / period_s))]
        speed = np.gradient(position, period_s)
        setpoints = np.column_stack((position, speed, np.gradient(speed, period_s)))
        drive = FeedDrive(settings, float(position[0]), _PRELOAD_PERCENT, seed * 1000 + number)
        frame = drive.advance(setpoints, np.full(len(setpoints), _PRELOAD_PERCENT))
        settle = round(max(_SETTLE_S - EDGE_S, 0.0) / period_s)
        there = {
            ANGLE: True,
            TORQUE: run.has_torque,
            TABLE_POSITION: run.transmission_m is not None,
        }
        kept = {name: frame.channels[name][settle:] for name, known in there.items() if known}
        made += runs_of([SampleFrame(frame.time_s[settle:], kept)], baseline, 3.0 * EDGE_S)
    return Session.of_runs(made, baseline, model_effects(machine))


def _drawn(machine: Machine, random: np.random.Generator) -> Machine:
    """Machine with its parameters drawn from their tolerances, cut off at 2.5 of them."""
    model = machine.model
    changes = {}
    for key in ("inertia_kg_m2", "viscous_nm_s_per_rad", "preload_drag_nm"):
        quantity = getattr(model, key)
        if quantity is not None:
            off = float(np.clip(random.standard_normal(), -2.5, 2.5)) * quantity.sigma
            changes[key] = quantity.model_copy(update={"value": quantity.value + off})
    return machine.model_copy(update={"model": model.model_copy(update=changes), "effects": ()})


def _traces(machine: Machine, random: np.random.Generator) -> list[ActiveEffect]:
    """A little of what every real axis has; the scale of the torque within half its tolerance."""
    tolerances, gain = parameter_tolerances(machine), error_of(Term.GAIN)
    traced = [effect for effect in effects().values() if effect.trace.ranges]
    phases = cycle(random.uniform(-3.1, 3.1, _PHASES))
    shares = iter(random.uniform(0.0, 1.0, sum(len(each.trace.ranges) for each in traced)))
    scales = {"N m": tolerances[error_of(Term.COULOMB)] / 0.01}
    found = []
    for effect in traced:
        values = {}
        for parameter in effect.parameters:
            if parameter.name in effect.trace.ranges:
                low, spread = effect.trace.ranges[parameter.name]
                scale = scales.get(parameter.unit, 1.0)
                values[parameter.name] = low * scale + spread * scale * next(shares)
            elif parameter.role is Role.PHASE:
                values[parameter.name] = next(phases)
        found.append(active_effect(effect.name, values))
    amount = get_effect(gain).parameters[0].name
    excess = 0.5 * tolerances[gain] * random.standard_normal()
    return [active_effect(gain, {amount: excess}), *found]
