"""What a motion could tell apart, before anything is measured."""

import functools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..messages.channels import ANGLE, TABLE_POSITION, TORQUE
from ..messages.samples import SampleFrame
from ..models.effects.registry import get_effect
from ..models.effects.signature import torque_signature, transmission_signature
from ..models.feed_drive import FeedDrive, FeedDriveSettings
from ..models.machine import Machine
from ..models.motion import MOTIONS, MotionError, Setpoints, motion_limits
from .dictionary import Dictionary
from .evidence import Noise, fit
from .pursuit import pursue
from .recorded import runs_of
from .session import TORQUE_GAP, Rows, Session
from .tolerance import tolerated
from .twin import rigid_baseline, rigid_plant

LONGEST_S = 60.0
DECISIVE = 5.0
"""Logarithm of the evidence from which on two explanations are told apart."""
_OBSERVATIONS = 400.0
_FLOOR_OF_NOISE = 2.0
_PRELOAD_PERCENT = 7.0


@dataclass(frozen=True, slots=True)
class Separation:
    """What a motion says of two effects.

    Attributes:
        evidence: expected logarithm of the evidence for `effect` against `rival`, if `effect` is
            there as a typical fault.
    """

    effect: str
    rival: str
    evidence: float


@dataclass(frozen=True, slots=True)
class Proposal:
    """A motion and how well it separates what is tied."""

    motion: str
    duration_s: float
    evidence: float
    separations: tuple[Separation, ...]


def rehearsed(machine: Machine, motion: str, rate_hz: float = 1000.0) -> Session:
    """A healthy axis on a named motion, simulated; at most `LONGEST_S` of it.

    Raises:
        MotionError: the axis does not allow the motion.
    """
    limits = motion_limits(machine)
    plan = MOTIONS[motion]
    natural_s = plan.duration_s(limits)
    count = round(min(natural_s or LONGEST_S, LONGEST_S) * rate_hz)
    segments = iter(plan(limits, np.random.default_rng(1)))
    setpoints = Setpoints(segments, limits.low_m, rate_hz).take(count)
    settings = FeedDriveSettings.of_machine(machine, rate_hz)
    settings = replace(settings, plant=rigid_plant(settings.plant))
    drive = FeedDrive(settings, limits.low_m, _PRELOAD_PERCENT, 1)
    frame = drive.advance(setpoints, np.full(count, _PRELOAD_PERCENT))
    kept = {name: frame.channels[name] for name in (ANGLE, TORQUE, TABLE_POSITION)}
    baseline = rigid_baseline(machine)
    return Session.of_runs(list(runs_of([SampleFrame(frame.time_s, kept)], baseline)), baseline)


def separations(session: Session, machine: Machine, names: Sequence[str]) -> list[Separation]:
    """How well a motion tells each of some effects from each other one."""
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    prior = tolerated(machine, period_s, session.baseline.coulomb_nm)
    library = [get_effect(name) for name in names]
    dictionary = Dictionary.of_session(session, prior, library)
    floor = {name: _FLOOR_OF_NOISE * rows.rms for name, rows in session.channels.items()}
    noise = Noise(floor, dict.fromkeys(floor, _OBSERVATIONS), floor)
    found = []
    for name in names:
        target = _aimed(dictionary, _typical(session, name))
        for rival in names:
            if rival != name:
                allowed = [a for a in target.candidates if target.atoms[a].name == rival]
                left = pursue(target, noise, allowed).rms if allowed else fit(target, (), noise).rms
                found.append(Separation(name, rival, _evidence(left, floor)))
    return found


def _typical(session: Session, name: str) -> dict[str, Rows]:
    """What a typical fault adds to the gap of each channel."""
    effect = get_effect(name)
    values = effect.complete({})
    baseline = session.baseline
    added = {}
    for channel, rows in session.channels.items():
        place = session.torque_column if channel == TORQUE_GAP else session.transmission_column
        signature = torque_signature if channel == TORQUE_GAP else transmission_signature
        curve = functools.partial(signature, effect, values, baseline=baseline)
        added[channel] = replace(rows, gap=place(curve))
    return added


def _aimed(dictionary: Dictionary, channels: Mapping[str, Rows]) -> Dictionary:
    """The dictionary with other gaps."""
    sums = {
        name: replace(
            each,
            cross=dictionary.columns[name].T @ channels[name].gap,
            square=float(channels[name].gap @ channels[name].gap),
        )
        for name, each in dictionary.sums.items()
    }
    return replace(dictionary, sums=sums, mean=np.zeros_like(dictionary.mean))


def _evidence(left: Mapping[str, float], floor: Mapping[str, float]) -> float:
    return sum(0.5 * _OBSERVATIONS * math.log1p((left[name] / floor[name]) ** 2) for name in left)


def propose(
    machine: Machine, tied: Collection[str], motions: Sequence[str] | None = None
) -> list[Proposal]:
    """Motions that the axis allows, the best first: least evidence of any pair, per time.

    A motion that decides all pairs comes before one that does not, and the shorter before the
    longer.
    """
    names = sorted(set(tied))
    found = []
    for motion in motions or MOTIONS:
        try:
            session = rehearsed(machine, motion)
        except MotionError:
            continue
        pairs = tuple(separations(session, machine, names))
        least = min((pair.evidence for pair in pairs), default=0.0)
        times = session.runs[-1].motion.time_s
        found.append(
            Proposal(motion, float(times[-1] - session.runs[0].motion.time_s[0]), least, pairs)
        )
    return sorted(
        found,
        key=lambda p: (
            p.evidence < DECISIVE,
            p.duration_s if p.evidence >= DECISIVE else -p.evidence,
        ),
    )
