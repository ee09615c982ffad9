"""Experiments that would decide: what a motion can tell apart, and which one is shortest."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from ..messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from ..models.effects.learned import learned_effects, model_effects
from ..models.effects.registry import get_effect
from ..models.feed_drive import FeedDrive, FeedDriveSettings
from ..models.machine import Machine
from ..models.motions.registry import MOTIONS, MotionError, Setpoints, motion_limits
from ..regression.run import Run
from .candidates.design_matrix import DesignMatrix, healthy_priors
from .candidates.regressors import candidates_of
from .residual.noise import Noise
from .selection.problem import Fit, SelectionProblem
from .session.recordings import runs_of
from .session.session import Session, rigid_baseline, rigid_plant

LONGEST_S = 60.0
DECISIVE = 5.0
"""Logarithm of the evidence from which on two explanations are told apart."""
_OBSERVATIONS = 400.0
_FLOOR_OF_NOISE = 2.0
_PRELOAD_PERCENT = 7.0
_NOTHING = 1e-9
_LEAST_RUN_S, _SETTLE_S, _MOST_HEALTHY_S = 0.3, 0.4, 300.0
ENDLESS_S = (10.0, 20.0, 40.0, 60.0, 150.0, 300.0)
"""Durations at which motions without end are tried."""


@dataclass(frozen=True, slots=True)
class Separation:
    """Separation of two effects by a motion."""

    effect: str
    rival: str | None  # None stands for a healthy axis
    evidence: float  # expected logarithm of the evidence for `effect` where it is there
    # what the rival leaves of each channel, over what a healthy axis leaves
    ratios: tuple[float, ...]
    strain: float  # squared distance of the parameters, in their tolerances, that the rival needs


def rehearsed(
    machine: Machine, motion: str, duration_s: float | None = None, rate_hz: float = 1000.0
) -> Session:
    """Simulate a healthy axis on a named motion; unless asked, at most `LONGEST_S` of it.

    Raises MotionError: the axis does not allow the motion.
    """
    limits, plan = motion_limits(machine), MOTIONS[motion]
    if duration_s is None:
        duration_s = min(plan.duration_s(limits) or LONGEST_S, LONGEST_S)
    segments = iter(plan(limits, np.random.default_rng(1)))
    setpoints = Setpoints(segments, limits.low_m, rate_hz).take(round(duration_s * rate_hz))
    settings, baseline = FeedDriveSettings.of_machine(machine, rate_hz), rigid_baseline(machine)
    frame = _driven(settings, setpoints, (ANGLE, TORQUE, TABLE_POSITION))
    return Session.of_runs(runs_of([frame], baseline), baseline)


def healthy_session(machine: Machine, runs: Sequence[Run]) -> Session:
    """Simulate a healthy axis with the channels of runs, of moving ones first, evenly spread."""
    baseline, made, known = rigid_baseline(machine), list[Run](), learned_effects(machine)
    every = math.ceil(sum(min(run.duration_s, LONGEST_S) for run in runs) / _MOST_HEALTHY_S)
    for run in sorted(runs, key=lambda each: not each.moving.any())[::every]:
        position = run.setpoint_m
        if position is None:
            position = machine.transmission_ratio_m_per_rad * run.motion.angle_rad
        position = position[: round(LONGEST_S / run.period_s)]
        speed = np.gradient(position, run.period_s)
        setpoints = np.column_stack((position, speed, np.gradient(speed, run.period_s)))
        there = {TORQUE: run.has_torque, TABLE_POSITION: run.transmission_m is not None}
        names = (ANGLE, *(name for name, is_there in there.items() if is_there))
        settings = FeedDriveSettings.of_machine(machine, 1.0 / run.period_s, known)
        frame = _driven(settings, setpoints, names, round(_SETTLE_S / run.period_s))
        made += runs_of([frame], baseline, _LEAST_RUN_S)
    return Session.of_runs(made, baseline, model_effects(machine))


def _driven(
    settings: FeedDriveSettings, setpoints: Floats, names: Sequence[str], start: int = 0
) -> SampleFrame:
    """Channels, from a row on, of a healthy, stiff axis that follows setpoints (n, 3)."""
    settings = replace(settings, plant=rigid_plant(settings.plant))
    drive = FeedDrive(settings, float(setpoints[0, 0]), _PRELOAD_PERCENT, 1)
    frame = drive.advance(setpoints, np.full(len(setpoints), _PRELOAD_PERCENT))
    channels = {name: frame.channels[name][start:] for name in names}
    return SampleFrame(frame.time_s[start:], channels)


def separations(
    session: Session,
    machine: Machine,
    names: Sequence[str],
    values: Mapping[str, Mapping[str, float]] | None = None,
) -> list[Separation]:
    """Separations of some effects, but for a fault, each from each other one, by a motion.

    Args:
        values: of the effects; of a typical fault unless given, or where those make no gap.
    """
    prior = healthy_priors(machine, session.runs[0].period_s, session.baseline.coulomb_nm)
    names = [name for name in names if not get_effect(name).is_fault]
    entries = candidates_of(session, [get_effect(name) for name in names])
    design = DesignMatrix.of_session(session, prior, entries)
    floor = {name: _FLOOR_OF_NOISE * rows.rms for name, rows in session.channels.items()}
    noise = Noise(floor, floor, dict.fromkeys(floor, _OBSERVATIONS), floor)
    found = []
    for name in names:
        effect = get_effect(name)
        for given in ((values or {}).get(name, {}), {}):
            full = effect.complete(given)
            added = {c: session.signature(c, effect, full) for c in session.channels}
            if any(np.any(gap) for gap in added.values()):
                break
        problem = SelectionProblem(session, machine, _aimed(design, added, floor), noise, {})
        fits: dict[str | None, Fit] = {None: problem.fit(())}
        for rival in (each for each in names if each != name):
            fits[rival] = problem.stepwise(problem.design.of_effects({rival}))
        count = design.first[design.nuisances]
        for other, fit in fits.items():
            ratios = tuple(fit.rms[channel] / floor[channel] for channel in floor)
            strain = float(fit.coefficients[:count] ** 2 @ problem.design.precision[:count])
            found.append(Separation(name, other, _evidence(ratios, strain), ratios, strain))
    return found


def least_strength(separation: Separation) -> float:
    """Least strength, as a share of the fault, that separates it from its rival; or infinite."""
    if max(*separation.ratios, separation.strain) < _NOTHING:
        return math.inf

    def short_of(strength: float) -> float:
        ratios = tuple(strength * ratio for ratio in separation.ratios)
        return _evidence(ratios, strength**2 * separation.strain) - DECISIVE

    return float(optimize.brentq(short_of, 0.0, 1e12))


def _aimed(
    design: DesignMatrix, gaps: Mapping[str, Floats], floor: Mapping[str, float]
) -> DesignMatrix:
    """Design matrix with other gaps; where an effect shows nothing its gap is hardly one."""
    equations = {}
    for name, each in design.equations.items():
        least, square = each.rows * (_NOTHING * floor[name]) ** 2, float(gaps[name] @ gaps[name])
        cross = design.columns[name].T @ gaps[name]
        equations[name] = replace(each, cross=cross, square=max(square, least))
    return replace(design, equations=equations, mean=np.zeros_like(design.mean))


def _evidence(ratios: Sequence[float], strain: float) -> float:
    return 0.5 * strain + sum(0.5 * _OBSERVATIONS * math.log1p(ratio**2) for ratio in ratios)


@dataclass(frozen=True, slots=True)
class Proposal:
    """Motion and how well it separates what is tied."""

    motion: str
    duration_s: float
    given_s: float | None  # duration to ask for; None where the motion has its own
    evidence: float  # of the pair that it separates least
    separations: tuple[Separation, ...]

    @property
    def decides(self) -> bool:
        """Evidence that tells every pair apart."""
        return self.evidence >= DECISIVE


def allowed_motions(
    machine: Machine, longest_s: float = LONGEST_S
) -> list[tuple[str, float, float | None]]:
    """Motions within the axis' limits, the shortest first: name, duration, duration to ask for."""
    limits = motion_limits(machine)
    found: list[tuple[str, float, float | None]] = []
    for name, motion in MOTIONS.items():
        try:
            own_s = motion.duration_s(limits)
        except MotionError:
            continue
        if own_s is None:
            found += [(name, each, each) for each in ENDLESS_S if each <= longest_s]
        elif own_s <= longest_s:
            found.append((name, own_s, None))
    return sorted(found, key=lambda each: each[1])


def propose(
    machine: Machine,
    tied: Collection[str],
    values: Mapping[str, Mapping[str, float]] | None = None,
    longest_s: float = LONGEST_S,
    progress: Callable[[str], None] = lambda _line: None,
) -> list[Proposal]:
    """Motions that were rehearsed until one decides, the best first: that one, or by evidence.

    Args:
        tied: names of effects.
        values: of the effects, as far as known; a typical fault's otherwise.

    Raises MotionError: the machine file allows no motion at all.
    """
    names = sorted(set(tied))
    found: list[Proposal] = []
    for motion, duration_s, given_s in allowed_motions(machine, longest_s):
        progress(f"rehearsing {motion}, {duration_s:.0f} s")
        try:
            session = rehearsed(machine, motion, duration_s)
        except MotionError:
            continue
        pairs = [p for p in separations(session, machine, names, values) if p.rival is not None]
        least = min((pair.evidence for pair in pairs), default=0.0)
        found.append(Proposal(motion, duration_s, given_s, least, tuple(pairs)))
        if found[-1].decides:
            break
    found.sort(key=lambda each: -sum(pair.evidence for pair in each.separations))
    return sorted(found, key=lambda each: (not each.decides, -round(each.evidence)))
