"""Session: all runs of one axis as rows of two channels, what the baseline leaves of each."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from scipy import ndimage

from ...messages.samples import Booleans, Floats, Integers
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.contribution import Change, Constant, Over, Side, SmoothTorque
from ...models.effects.effect import ActiveEffect, Effect, Term
from ...models.effects.learned import NAME, learned_effects
from ...models.effects.registry import error_of
from ...models.effects.signature import torque_signature, transmission_signature
from ...models.machine import DEFAULT_TOLERANCE, MEASURED_SUM, Machine
from ...models.plant.two_mass import Plant
from ...regression.run import Run

TORQUE_GAP, TRANSMISSION_GAP = "torque_nm", "transmission_m"
_SIGNATURE = {TORQUE_GAP: torque_signature, TRANSMISSION_GAP: transmission_signature}
CHANNEL_UNITS = {TORQUE_GAP: "N m", TRANSMISSION_GAP: "m"}
CHANNEL_WORDS = {TORQUE_GAP: "torque", TRANSMISSION_GAP: "position between motor and table"}
MOST_ROWS = 60_000
"""Of a channel; of a longer session every second row is kept, or every third, and so on."""
REST_S = 1.0
"""Shorter rests are part of a motion."""
BLOCK_S = 5.0
"""Rows are held out, and resampled, in blocks of about this length."""
FOLDS = 4
_LEAST_BLOCKS = 8


def rms(values: Floats) -> float:
    """Root mean square of a series, (n,)."""
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Rows of one channel of a session.

    Attributes:
        gap: measured minus modelled, (n,).
        variables: name -> what was the case at each row, (n,).
        block: number of the block of time, (n,).
    """

    gap: Floats
    variables: Mapping[str, Floats]
    block: Integers

    @property
    def rms(self) -> float:
        """Root mean square of the gap."""
        return rms(self.gap)

    def at(self, kept: Booleans | slice) -> "Rows":
        """Rows that a mask (n,) or a slice keeps."""
        variables = {name: values[kept] for name, values in self.variables.items()}
        return Rows(self.gap[kept], variables, self.block[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Runs and the rows that follow from them.

    Attributes:
        baseline: rigid; `modelled` effects belong to the model as well.
        channels: those of `TORQUE_GAP` and `TRANSMISSION_GAP` that were recorded.
        rows: channel -> its rows in each run, thinned to those of the session, (k,) each.
        motions: of the runs, with the `modelled` effects in the model torque.
        beside: session with what it has beyond the healthy machine, if that is known, as its gap.
        healthy_floor: channel -> root mean square by which a healthy recording may part from it.
    """

    runs: tuple[Run, ...]
    baseline: Baseline
    modelled: tuple[ActiveEffect, ...]
    channels: Mapping[str, Rows]
    rows: Mapping[str, tuple[Integers, ...]]
    motions: tuple[Motion, ...]
    beside: "Callable[[Session], Session]" = lambda session: session
    healthy_floor: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of_runs(
        cls, runs: Sequence[Run], baseline: Baseline, modelled: Sequence[ActiveEffect] = ()
    ) -> Self:
        """Session of some runs; a channel counts as recorded where any run has it."""
        count = sum(len(run.motion) // run.low_pass.step + 1 for run in runs)
        every = max(-(-count // MOST_ROWS), 1)
        channels, rows = {}, {}
        for name in CHANNEL_UNITS:
            masks = [compared(name, run) for run in runs]
            held = [each for each in zip(runs, masks, strict=True) if each[1].any()]
            if held:
                gap = np.concatenate([channel_gap(name, r, baseline, modelled) for r, _ in held])
                gap = gap - gap.mean() if name == TRANSMISSION_GAP else gap
                channels[name] = _rows(gap, held).at(slice(None, None, every))
            kept, seen = [], 0  # each so-many-th row, counted through all runs
            for mask in masks:
                numbers = np.flatnonzero(mask)
                kept.append(numbers[-seen % every :: every])
                seen += len(numbers)
            rows[name] = tuple(kept)
        motions = tuple(_whole(run.motion, baseline, modelled) for run in runs)
        return cls(tuple(runs), baseline, tuple(modelled), channels, rows, motions)

    def with_torque_of(self, made: Sequence[ActiveEffect]) -> Self:
        """Session whose motions have the torque of further effects; its gap is as it was."""
        whole = (*self.modelled, *made)
        motions = tuple(_whole(run.motion, self.baseline, whole) for run in self.runs)
        return replace(self, motions=motions)

    def with_load_of(self, made: Sequence[ActiveEffect]) -> Self:
        """Session whose springs carry further effects' loads; its gap is as it was."""
        return replace(self, motions=tuple(_loaded(each, made) for each in self.motions))

    def column(self, channel: str, curve: Callable[[Motion], Floats]) -> Floats:
        """Column of a channel from a function of the motion, (n,).

        The torque counts as zero at rest; the transmission has no mean.
        """
        parts = []
        for run, motion, rows in zip(self.runs, self.motions, self.rows[channel], strict=True):
            if len(rows):
                values = curve(motion)
                if channel == TORQUE_GAP:
                    values = np.where(run.moving, values, 0.0)
                parts.append(run.low_pass.at(values, rows))
        column: Floats = np.concatenate(parts)
        if channel == TRANSMISSION_GAP:
            column -= column.mean()
        return column

    def signature(self, channel: str, effect: Effect, values: Mapping[str, float]) -> Floats:
        """Column of an effect in a channel, (n,)."""
        return self.column(channel, lambda m: _SIGNATURE[channel](effect, values, m, self.baseline))

    def folds(self, time_s: Floats) -> Integers:
        """Number of the fold of each time, (n,): of one block 0, of the next 1, and so on."""
        spans_s = [np.ptp(rows.variables["time_s"]) for rows in self.channels.values()]
        block_s = min(BLOCK_S, max(*spans_s, 1e-9) / _LEAST_BLOCKS)
        return np.floor(time_s / block_s).astype(np.int64) % FOLDS

    @property
    def fold(self) -> dict[str, Integers]:
        """Fold of each row, by channel, (n,)."""
        return {name: self.folds(rows.variables["time_s"]) for name, rows in self.channels.items()}

    @property
    def torque_rms_nm(self) -> float:
        """Root mean square of the torque in motion, N m; NaN where none was recorded."""
        if TORQUE_GAP not in self.channels:
            return math.nan
        return rms(self.column(TORQUE_GAP, lambda motion: motion.torque_nm))


def _whole(motion: Motion, baseline: Baseline, modelled: Sequence[ActiveEffect]) -> Motion:
    """Motion with some effects in its torques; what lags, or scales, does so with all."""
    motion = _loaded(motion, modelled)
    for each in sorted(modelled, key=lambda e: e.effect.term in (Term.GAIN, Term.LAG)):
        made_nm = torque_signature(each.effect, each.values, motion, baseline)
        motion = replace(motion, model_torque_nm=motion.model_torque_nm + made_nm)
    return motion


def _loaded(motion: Motion, made: Sequence[ActiveEffect]) -> Motion:
    """Motion whose springs carry what some effects hold, or move, on the table."""
    load_nm = motion.load_torque_nm
    for part in (part for each in made for part in each.contributions):
        match part:
            case SmoothTorque(Over.TIME, torque_nm, Side.TABLE):
                load_nm = load_nm + torque_nm(motion.time_s)
            case Change(Constant.TABLE_INERTIA, value):
                load_nm = load_nm + value * motion.table_rad_s2
    return replace(motion, load_torque_nm=load_nm)


def compared(channel: str, run: Run) -> Booleans:
    """Rows of a run at which a channel is compared: in a rest friction holds a spring anywhere."""
    if channel == TORQUE_GAP:
        return run.compared_rows & run.has_torque
    rows = max(round(REST_S / run.low_pass.period_s), 1)
    lasts = ndimage.minimum_filter1d(~run.moving, rows, mode="constant")
    resting = ndimage.maximum_filter1d(lasts, rows, mode="constant", origin=rows % 2 - 1)
    # nobody knows from where a run came before its first motion, which the low-pass spreads
    begun = np.cumsum(run.moving) > len(run.low_pass.taps) // 2
    return np.asarray((begun & ~resting)[:: run.low_pass.step] & (run.transmission_m is not None))


def channel_gap(
    channel: str, run: Run, baseline: Baseline, modelled: Sequence[ActiveEffect]
) -> Floats:
    """Measured less modelled at the rows of a run that are compared, N m or m, (n,)."""
    if channel == TORQUE_GAP:
        left = run.motion.torque_nm - _whole(run.motion, baseline, modelled).model_torque_nm
        return run.resting_zero(left)[compared(channel, run)]
    assert run.transmission_m is not None
    loaded = _loaded(run.motion, modelled)  # beside what is learned, whose springs the baseline has
    pairs = ((e, run.motion if e.effect.name == NAME else loaded) for e in modelled)
    known = [transmission_signature(e.effect, e.values, motion, baseline) for e, motion in pairs]
    return run.low_pass(run.transmission_m - sum(known))[compared(channel, run)]


def _rows(gap: Floats, kept: Sequence[tuple[Run, Booleans]]) -> Rows:
    names: dict[str, Callable[[Run], Floats]] = {
        "motor_speed_rad_s": lambda run: run.motion.speed_rad_s,
        "motor_acceleration_rad_s2": lambda run: run.motion.acceleration_rad_s2,
        "table_position_m": lambda run: run.motion.position_m,
        "motor_angle_rad": lambda run: np.mod(run.motion.angle_rad, 2.0 * np.pi),
        "time_s": lambda run: run.motion.time_s,
        "direction": lambda run: run.motion.approach,
    }
    if all(run.temperature_c is not None for run, _ in kept):
        names["temperature_c"] = lambda run: run.motion.temperature_c
    variables = {
        name: np.concatenate([run.at_rows(of(run))[rows] for run, rows in kept])
        for name, of in names.items()
    }
    _, block = np.unique(np.floor(variables["time_s"] / BLOCK_S), return_inverse=True)
    return Rows(gap, variables, block.astype(np.int64))


_STIFFENING = 300.0


def rigid_baseline(machine: Machine) -> Baseline:
    """Baseline as the machine file means it: the learned spring winds up, and nothing else.

    What commissioning learned is a stretch per acceleration, a spring where the mass is stated.
    """
    baseline, springs = Baseline.of_machine(machine), Counter[Constant]()
    is_stated = machine.model.table_mass_kg is not None
    for each in learned_effects(machine) if is_stated else ():
        changes = (c for c in each.effect.contributions(each.values) if isinstance(c, Change))
        springs.update({change.quantity: change.value for change in changes})
    sloped = springs[Constant.COMPLIANCE_SLOPE] * baseline.position_m
    compliance = np.maximum(springs[Constant.COMPLIANCE] + sloped, 0.0)
    return replace(baseline, compliance_m_per_n=compliance)


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

    How well the inertia is known says nothing of the torque's own scale. Of a commissioned axis the
    sum of its frictions was measured.
    """
    model, sum_share = machine.model, math.inf if machine.commissioned is None else MEASURED_SUM
    drag = model.preload_drag_nm
    tolerances = {
        Term.INERTIA: model.inertia_kg_m2.sigma,
        Term.VISCOUS: model.viscous_nm_s_per_rad.sigma,
        Term.COULOMB: machine.other_drag_nm.sigma
        + (min(drag.sigma, sum_share * abs(drag.value)) if drag else 0.0),
        Term.GAIN: min(model.inertia_kg_m2.tolerance, DEFAULT_TOLERANCE),
    }
    return {error_of(term): sigma for term, sigma in tolerances.items()}
