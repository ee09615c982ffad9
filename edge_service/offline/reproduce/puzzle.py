"""`edge-service reproduce puzzle`: why a linear model would not fit the bench (Figure 5.13).

The linear two-mass model of the print, with the bench's own inertia and viscous friction and one
spring, meets a simulated bench that has the measured kind of friction, a stiffness that falls along
the stroke, and a warm-up. Fitting its parameters helps little. The diagnosis says what the model
lacks, in the order in which it matters; what it names is put into the model, and it is asked again.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ...command_answer import Answer, progress
from ...config import DEFAULT_MACHINE, load_machine
from ...diagnose.pipeline import diagnose_session
from ...diagnose.session.recordings import runs_of
from ...diagnose.session.session import TORQUE_GAP, TRANSMISSION_GAP, Session, rigid_baseline
from ...messages.samples import SampleFrame
from ...models.effects.registry import get_effect, machine_effects, parse_effect
from ...models.effects.signature import transmission_signature
from ...models.feed_drive import FeedDrive, FeedDriveSettings
from ...models.machine import EffectConfig, Machine, Quantity
from ...models.motions.registry import MOTIONS, Setpoints, motion_limits
from ..report.page import ESTIMATE, MUTED, STYLE, TRUTH, write_study

BENCH = {"guide_force_n": 0.0, "table_mass_kg": 20.0}
HIDDEN = ("stribeck:excess_nm=0.1,speed_rad_s=4", "warmup:excess_nm=0.08,time_constant_s=200")
"""Beside the Coulomb friction and the falling stiffness that the bench has anyway."""
SESSION = (("acceleration", None), ("friction", None), ("warmup", 60.0), ("production", 40.0))
ROUNDS = 2
_UNIT_M_PER_N = 1e-8
_RATE_HZ = 1000.0
_PRELOAD_PERCENT = 6.85
SEED = 1
CHANNELS = (("torque_nm", "N m", 1.0), ("transmission_m", "µm", 1e6))
_LABELS = {"torque_nm": "torque gap", "transmission_m": "gap of table against motor"}


@dataclass(frozen=True, slots=True)
class Step:
    """An effect that was put into the model, and the gap by channel that is left with it."""

    effect: str
    gap: dict[str, float]


@dataclass(frozen=True, slots=True)
class Puzzle:
    """The whole way from the linear model down."""

    # before, fitted, floor: root mean square gap by channel of the linear model, of the same with
    # the parameters that fit best, and of what no model could explain
    before: dict[str, float]
    fitted: dict[str, float]
    floor: dict[str, float]
    verdicts: tuple[str, ...]  # of the diagnoses
    # effects that they named, in the order in which they were put into the model
    steps: tuple[Step, ...]

    def as_text(self) -> str:
        """Report of what is missing, in which order, and how far each addition shrinks the gap."""
        return "\n".join(
            [
                "the linear two-mass model against the bench; root mean square gap",
                _line("linear model", self.before),
                _line("the same, fitted", self.fitted),
                *(_line(f"+ {step.effect}", step.gap) for step in self.steps),
                _line("noise floor", self.floor),
                f"  diagnoses: {', '.join(self.verdicts)}",
            ]
        )


def _line(name: str, gap: dict[str, float]) -> str:
    shown = [f"{factor * gap[channel]:8.3g} {unit}" for channel, unit, factor in CHANNELS]
    return f"  {name:<24}" + "  ".join(shown)


def reproduce_puzzle(out: Path, seed: int = SEED) -> Answer:
    """Write `report.html` and `puzzle.png` into `out`; returns the story."""
    found = solve(seed)
    named = " and ".join(step.effect.replace("_", " ") for step in found.steps) or "nothing"
    verdict, title = f"The linear model lacks {named}.", "Why linear models did not fit the bench"
    write_study(out, "puzzle", title, verdict, found.as_text(), draw_puzzle(found))
    return Answer(f"{found.as_text()}\nreport: {out / 'report.html'}", found)


def solve(seed: int = SEED) -> Puzzle:
    """Rebuild the situation, and ask the diagnosis until it names nothing more."""
    progress("the bench runs")
    bench = bench_machine()
    frames = recorded(bench, seed)
    machine = linear_model(bench, frames)
    before, best = gap_of(machine, frames), gap_of(fitted(machine, frames), frames)
    floor: dict[str, float] = {}
    verdicts: list[str] = []
    steps: list[Step] = []
    for number in range(1, ROUNDS + 1):
        progress(f"diagnosis {number}")
        found = diagnose_session(session_of(machine, frames), machine, progress=progress)
        floor = {name: each.floor for name, each in found.gap.items()}
        verdicts.append(found.verdict.value)
        for effect in sorted(found.effects, key=lambda each: -each.shrink.estimate):
            for values in effect.entries:
                machine = _with_effect(machine, effect.name, values)
            steps.append(Step(effect.name, gap_of(machine, frames)))
        if not found.effects:
            break
    return Puzzle(before, best, floor, tuple(verdicts), tuple(steps))


def bench_machine() -> Machine:
    """The bench with a guide that rubs."""
    machine = load_machine(DEFAULT_MACHINE)
    more = {name: Quantity(value=value) for name, value in BENCH.items()}
    return machine.model_copy(update={"model": machine.model.model_copy(update=more)})


def recorded(bench: Machine, seed: int = SEED) -> list[SampleFrame]:
    """The session on the bench, a recording for each motion."""
    limits = motion_limits(bench)
    hidden = [parse_effect(text) for text in HIDDEN]
    settings = FeedDriveSettings.of_machine(bench, _RATE_HZ, hidden)
    drive = FeedDrive(settings, limits.low_m, _PRELOAD_PERCENT, seed)
    frames = []
    for number, (name, duration_s) in enumerate(SESSION, start=1):
        random = np.random.default_rng((seed, number))
        plan = MOTIONS[name].plan(limits, random, duration_s=duration_s)
        count = round(plan.duration_s * _RATE_HZ)
        setpoints = Setpoints(iter(plan.segments), limits.low_m, _RATE_HZ).take(count)
        frames.append(drive.advance(setpoints, np.full(count, _PRELOAD_PERCENT)))
    return frames


def linear_model(bench: Machine, frames: Sequence[SampleFrame]) -> Machine:
    """Inertia and viscous friction of the bench, no dry friction, the one spring that fits best."""
    model = bench.model.model_copy(update={"preload_drag_nm": Quantity(value=0.0)})
    linear = bench.model_copy(update={"model": model})
    session, effect = session_of(linear, frames), get_effect("compliance")
    unit = effect.complete({"level_m_per_n": _UNIT_M_PER_N})
    column = session.column(
        TRANSMISSION_GAP,
        lambda motion: transmission_signature(effect, unit, motion, session.baseline),
    )
    gap = session.channels[TRANSMISSION_GAP].gap
    spring = _UNIT_M_PER_N * float(column @ gap / (column @ column))
    return _with_effect(linear, "compliance", {"level_m_per_n": spring})


def fitted(linear: Machine, frames: Sequence[SampleFrame]) -> Machine:
    """The linear model with the inertia and the viscous friction that fit best: least squares."""
    session = session_of(linear, frames)
    terms = (lambda motion: motion.acceleration_rad_s2), (lambda motion: motion.speed_rad_s)
    columns = np.column_stack([session.column(TORQUE_GAP, term) for term in terms])
    off = np.linalg.lstsq(columns, session.channels[TORQUE_GAP].gap, rcond=None)[0]
    better = {}
    for name, by in zip(("inertia_kg_m2", "viscous_nm_s_per_rad"), off, strict=True):
        stated: Quantity = getattr(linear.model, name)
        better[name] = stated.model_copy(update={"value": stated.value + float(by)})
    return linear.model_copy(update={"model": linear.model.model_copy(update=better)})


def _with_effect(machine: Machine, name: str, values: Mapping[str, float]) -> Machine:
    parameters = {key: Quantity(value=float(value)) for key, value in values.items()}
    added = EffectConfig(name=name, parameters=parameters)
    return machine.model_copy(update={"effects": (*machine.effects, added)})


def session_of(machine: Machine, frames: Sequence[SampleFrame]) -> Session:
    """The bench's recordings beside a model."""
    baseline = rigid_baseline(machine)
    return Session.of_runs(list(runs_of(frames, baseline)), baseline, machine_effects(machine))


def gap_of(machine: Machine, frames: Sequence[SampleFrame]) -> dict[str, float]:
    """Root mean square gap by channel."""
    return {name: rows.rms for name, rows in session_of(machine, frames).channels.items()}


def draw_puzzle(found: Puzzle) -> Figure:
    """One panel per channel; a bar falls from what was left to what is left.

    The second bar is aside of that: the linear model with the parameters that fit best.
    """
    before, best, floor, steps = found.before, found.fitted, found.floor, found.steps
    names = ["linear model", "(fitted)", *(f"+ {step.effect.replace('_', ' ')}" for step in steps)]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 0.9 + 0.33 * len(names)), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (channel, unit, factor) in zip(panels, CHANNELS, strict=True):
            levels = [factor * before[channel], *(factor * each.gap[channel] for each in steps)]
            places = [0, *range(2, 2 + len(steps))]
            axes.barh(places, levels, color=ESTIMATE, height=0.6, zorder=2)
            axes.barh(1, factor * best[channel], color=MUTED, height=0.6, zorder=2)
            for place, (above, level) in zip(places[1:], itertools.pairwise(levels), strict=True):
                axes.barh(place, above - level, left=level, color=MUTED, alpha=0.35, height=0.6)
            shown = [*zip(places, levels, strict=True), (1, factor * best[channel])]
            for place, level in shown:
                axes.text(level, place, f" {level:.3g}", va="center", fontsize=8)
            axes.margins(x=0.12)
            axes.axvline(factor * floor[channel], color=TRUTH, linestyle=":")
            axes.set_xlabel(f"{_LABELS[channel]}, {unit} rms")
        panels[0].set_yticks(range(len(names)), names)
        panels[0].invert_yaxis()
    return figure
