"""The diagnosis of a session: the gap, where it lives, what causes it, and how far it shrinks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..fingerprint.regression import effective_size
from ..models.effects.effect import Effect
from ..models.effects.registry import effects
from ..models.machine import Machine
from .answer import ChannelGap, Diagnosis, NamedEffect, Verdict
from .beside_force import beside_force
from .causes import find_causes
from .conclusion import concluded
from .dictionary import Dictionary
from .evidence import Fit, Noise, fit
from .explained import Weighed
from .impostor import FORCE
from .nameless import nameless_forms
from .pushes import lone_forms
from .session import TORQUE_GAP, Session
from .tolerance import Tolerated, limits_of, tolerated
from .twin import HealthyGap
from .unknown import left_shares

__all__ = ["ChannelGap", "Diagnosis", "NamedEffect", "Verdict", "diagnose_session"]

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""


def diagnose_session(
    session: Session,
    machine: Machine,
    healthy: HealthyGap,
    library: Sequence[Effect] | None = None,
    progress: Callable[[str], None] = lambda _line: None,
) -> Diagnosis:
    """Diagnose one session.

    Args:
        healthy: gaps of healthy twins on the same motion.
        library: entries that may be named; all of them unless given.
    """
    entries = tuple(effects().values()) if library is None else tuple(library)
    progress("signatures of the library")
    dictionary, noise = _prepared(session, machine, healthy, entries)
    progress("sets of effects")
    limits = limits_of(_prior(session, machine))
    causes = find_causes(dictionary, noise, limits)
    noise = _renoised(session, dictionary, causes.best.fit, noise)
    causes = find_causes(dictionary, noise, limits)
    left: Mapping[str, float] = causes.best.fit.rms
    if FORCE in causes.best.material:
        causes, left = beside_force(session, dictionary, noise, limits, causes)
    unexplained = left_shares(session, left, healthy, healthy.left)
    progress("values and held-out motion")
    return concluded(
        Weighed(session, machine, dictionary, noise, healthy, limits, causes, unexplained)
    )


def _prior(session: Session, machine: Machine) -> Sequence[Tolerated]:
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    return tolerated(machine, period_s, session.baseline.coulomb_nm)


def _prepared(
    session: Session, machine: Machine, healthy: HealthyGap, entries: Sequence[Effect]
) -> tuple[Dictionary, Noise]:
    searched = [each for each in entries if each.name != FORCE]
    dictionary = Dictionary.of_session(session, _prior(session, machine), searched)
    dictionary = dictionary.with_atoms(session, list(nameless_forms(session)))
    noise = Noise(
        floor={name: float(np.median(healthy.before[name])) for name in session.channels},
        effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
        discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
    )
    if TORQUE_GAP in session.channels and len(searched) < len(entries):
        dictionary = _with_pushes(session, dictionary, noise)
    return dictionary, noise


def _with_pushes(session: Session, dictionary: Dictionary, noise: Noise) -> Dictionary:
    """The dictionary with forces where the torque has a mean of its own for a while."""
    bare = fit(dictionary, (), noise)
    modelled = dictionary.modelled(TORQUE_GAP, bare.atoms, bare.coefficients)
    left = session.channels[TORQUE_GAP].gap - modelled
    return dictionary.with_atoms(session, lone_forms(session, left))


def _renoised(session: Session, dictionary: Dictionary, best: Fit, noise: Noise) -> Noise:
    """The noise with as many independent observations as the residual of the best fit has."""
    effective = {}
    for name, rows in session.channels.items():
        left = rows.gap - dictionary.modelled(name, best.atoms, best.coefficients)
        effective[name] = float(np.clip(effective_size(left), 40.0, MOST_EFFECTIVE))
    return replace(noise, effective=effective)
