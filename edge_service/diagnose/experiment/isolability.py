"""Isolability of effects: what a motion could tell apart, before anything is measured."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...messages.channels import ANGLE, TABLE_POSITION, TORQUE
from ...messages.samples import SampleFrame
from ...models.effects.registry import get_effect
from ...models.feed_drive import FeedDrive, FeedDriveSettings
from ...models.machine import Machine
from ...models.motions.registry import MOTIONS, Setpoints, motion_limits
from ..candidates.design_matrix import DesignMatrix
from ..candidates.healthy_prior import healthy_priors
from ..selection.noise import Noise
from ..selection.problem import Fit, SelectionProblem
from ..selection.stepwise import select_stepwise
from ..session.recordings import runs_of
from ..session.session import Rows, Session
from ..session.twin import rigid_baseline, rigid_plant

LONGEST_S = 60.0
DECISIVE = 5.0
"""Logarithm of the evidence from which on two explanations are told apart."""
_OBSERVATIONS = 400.0
_FLOOR_OF_NOISE = 2.0
_PRELOAD_PERCENT = 7.0
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class Separation:
    """Separation of two effects by a motion.

    Attributes:
        rival: None stands for a healthy axis.
        evidence: expected logarithm of the evidence for `effect` against `rival`, if `effect` is
            there.
        ratios: what the rival leaves of each channel, over what a healthy axis leaves.
        strain: squared distance of the parameters from their values, in their tolerances, that
            the rival needs.
    """

    effect: str
    rival: str | None
    evidence: float
    ratios: tuple[float, ...]
    strain: float


def rehearsed(
    machine: Machine, motion: str, duration_s: float | None = None, rate_hz: float = 1000.0
) -> Session:
    """Simulate a healthy axis on a named motion; unless asked, at most `LONGEST_S` of it.

    Args:
        duration_s: of the rehearsal.

    Raises:
        MotionError: the axis does not allow the motion.
    """
    limits = motion_limits(machine)
    plan = MOTIONS[motion]
    if duration_s is None:
        duration_s = min(plan.duration_s(limits) or LONGEST_S, LONGEST_S)
    count = round(duration_s * rate_hz)
    segments = iter(plan(limits, np.random.default_rng(1)))
    setpoints = Setpoints(segments, limits.low_m, rate_hz).take(count)
    settings = FeedDriveSettings.of_machine(machine, rate_hz)
    settings = replace(settings, plant=rigid_plant(settings.plant))
    drive = FeedDrive(settings, limits.low_m, _PRELOAD_PERCENT, 1)
    frame = drive.advance(setpoints, np.full(count, _PRELOAD_PERCENT))
    kept = {name: frame.channels[name] for name in (ANGLE, TORQUE, TABLE_POSITION)}
    baseline = rigid_baseline(machine)
    return Session.of_runs(list(runs_of([SampleFrame(frame.time_s, kept)], baseline)), baseline)


def separations(
    session: Session,
    machine: Machine,
    names: Sequence[str],
    values: Mapping[str, Mapping[str, float]] | None = None,
) -> list[Separation]:
    """Separations of some effects, each from each other one, by a motion.

    A fault is left out: no motion shows it, the estimator knows it or it is tied with friction.

    Args:
        values: of the effects; those of a typical fault unless given, or where given values make
            no gap.
    """
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    prior = healthy_priors(machine, period_s, session.baseline.coulomb_nm)
    names = [name for name in names if not get_effect(name).is_fault]
    library = [get_effect(name) for name in names]
    design = DesignMatrix.of_session(session, prior, library)
    floor = {name: _FLOOR_OF_NOISE * rows.rms for name, rows in session.channels.items()}
    noise = Noise(floor, floor, dict.fromkeys(floor, _OBSERVATIONS), floor)
    found = []
    for name in names:
        added = _faulty(session, name, (values or {}).get(name, {}))
        if not any(np.any(rows.gap) for rows in added.values()):
            added = _faulty(session, name, {})
        problem = SelectionProblem(_aimed(design, added, floor), noise, {})
        alone = problem.fit(())
        fits = {None: alone} | {
            rival: select_stepwise(problem, allowed)
            if (allowed := problem.design.of_effects({rival}))
            else alone
            for rival in names
            if rival != name
        }
        found += [_separation(name, rival, each, problem) for rival, each in fits.items()]
    return found


def _separation(name: str, rival: str | None, found: Fit, problem: SelectionProblem) -> Separation:
    floor, count = problem.noise.floor, problem.design.nuisance_columns
    ratios = tuple(found.rms[channel] / floor[channel] for channel in floor)
    strain = float(found.coefficients[:count] ** 2 @ problem.design.precision[:count])
    return Separation(name, rival, _evidence(ratios, strain), ratios, strain)


def least_strength(separation: Separation) -> float:
    """Least strength, as a share of the fault, that separates it from its rival; or infinite."""
    if max(*separation.ratios, separation.strain) < _NOTHING:
        return math.inf
    low, high = 1e-6, 1e6
    for _ in range(60):
        middle = math.sqrt(low * high)
        ratios = tuple(middle * ratio for ratio in separation.ratios)
        enough = _evidence(ratios, middle**2 * separation.strain) >= DECISIVE
        low, high = (low, middle) if enough else (middle, high)
    return high


def _faulty(session: Session, name: str, given: Mapping[str, float]) -> dict[str, Rows]:
    """Contribution of a fault to the gap of each channel."""
    effect = get_effect(name)
    values = effect.complete(given)
    return {
        channel: replace(rows, gap=session.signature(channel, effect, values))
        for channel, rows in session.channels.items()
    }


def _aimed(
    design: DesignMatrix, channels: Mapping[str, Rows], floor: Mapping[str, float]
) -> DesignMatrix:
    """Design matrix with other gaps; where an effect shows nothing its gap is hardly one."""
    equations = {
        name: replace(
            each,
            cross=design.columns[name].T @ channels[name].gap,
            square=max(
                float(channels[name].gap @ channels[name].gap),
                each.rows * (_NOTHING * floor[name]) ** 2,
            ),
        )
        for name, each in design.equations.items()
    }
    return replace(design, equations=equations, mean=np.zeros_like(design.mean))


def _evidence(ratios: Sequence[float], strain: float) -> float:
    return 0.5 * strain + sum(0.5 * _OBSERVATIONS * math.log1p(ratio**2) for ratio in ratios)
