"""The diagnosis of a session: the gap, where it lives, what causes it, and how far it shrinks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..models.effects.effect import Effect
from ..models.effects.registry import effects
from ..models.machine import Machine
from .candidates.design_matrix import DesignMatrix
from .candidates.force_pulses import FORCE, ForcePulse, pulses_of_session
from .candidates.null_shapes import null_shapes
from .candidates.regressor import CandidateRegressor
from .estimation.contributions import SelectedModel
from .result import ChannelGap, Diagnosis, NamedEffect, Verdict
from .selection.beside_force import beside_force
from .selection.evidence import Fit, Noise, fit
from .selection.observability import is_too_slow
from .selection.posterior import select_effects
from .session.healthy_prior import HealthyPrior, healthy_priors, parameter_priors, stated_tolerance
from .session.noise_floor import Floor, noise_floor
from .session.session import TORQUE_GAP, Session
from .validation.caveats import torque_rms_nm
from .validation.unexplained import unexplained_shares
from .validation.verdict import conclude

__all__ = ["ChannelGap", "Diagnosis", "NamedEffect", "Verdict", "diagnose_session"]

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""


def diagnose_session(
    session: Session,
    machine: Machine,
    library: Sequence[Effect] | None = None,
    progress: Callable[[str], None] = lambda _line: None,
) -> Diagnosis:
    """Diagnose one session.

    Args:
        library: entries that may be named; all of them unless given.
    """
    entries = tuple(effects().values()) if library is None else tuple(library)
    progress("signatures of the library")
    design, noise = _prepared(session, machine, entries)
    progress("sets of effects")
    priors = parameter_priors(_prior(session, machine))
    posterior = select_effects(design, noise, priors)
    first = posterior.best.fit
    noise = _renoised(session, machine, design, first, noise)
    posterior = select_effects(design, noise, priors, first.regressors[design.tolerated :])
    left: Mapping[str, float] = posterior.best.fit.rms
    if FORCE in posterior.best.material:
        posterior, left = beside_force(session, design, noise, priors, posterior)
    unexplained = unexplained_shares(session, left, noise)
    progress("values and held-out motion")
    return conclude(SelectedModel(session, machine, design, noise, priors, posterior, unexplained))


def _prior(session: Session, machine: Machine) -> Sequence[HealthyPrior]:
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    return healthy_priors(machine, period_s, session.baseline.coulomb_nm)


def _prepared(
    session: Session, machine: Machine, entries: Sequence[Effect]
) -> tuple[DesignMatrix, Noise]:
    searched = [
        each for each in entries if each.name != FORCE and not is_too_slow(each.name, session)
    ]
    prior = _prior(session, machine)
    gaps = {name: rows.gap for name, rows in session.channels.items()}
    floor = _above_healthy(session, noise_floor(session, gaps))
    noise = Noise(
        floor=floor,
        tolerance=stated_tolerance(machine, floor, torque_rms_nm(session)),
        effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
        discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
    )
    more: list[CandidateRegressor] = list(null_shapes(session))
    if TORQUE_GAP in session.channels and FORCE in {each.name for each in entries}:
        more += _force_pulses(session, prior, noise)
    return DesignMatrix.of_session(session, prior, searched, more), noise


def _force_pulses(
    session: Session, prior: Sequence[HealthyPrior], noise: Noise
) -> Sequence[ForcePulse]:
    """Forces where the torque has a mean of its own for a while."""
    healthy = DesignMatrix.of_session(session, prior, ())
    bare = fit(healthy, (), noise)
    modelled = healthy.modelled(TORQUE_GAP, bare.regressors, bare.coefficients)
    return pulses_of_session(session, session.channels[TORQUE_GAP].gap - modelled)


def _above_healthy(session: Session, floor: Mapping[str, Floor]) -> dict[str, float]:
    """The floor, at least that by which healthy recordings part from one another."""
    healthy = {} if session.healthy is None else session.healthy.floor
    return {name: max(each.rms, healthy.get(name, 0.0)) for name, each in floor.items()}


def _renoised(
    session: Session, machine: Machine, design: DesignMatrix, best: Fit, noise: Noise
) -> Noise:
    """The noise as the residual of the best fit has it: independent observations, and floor."""
    left = {
        name: rows.gap - design.modelled(name, best.regressors, best.coefficients)
        for name, rows in session.channels.items()
    }
    again = noise_floor(session, left)
    effective = {
        name: float(np.clip(each.independent, 40.0, MOST_EFFECTIVE)) for name, each in again.items()
    }
    bounded = _above_healthy(session, again)
    floor = {name: min(bounded[name], rms) for name, rms in noise.floor.items()}
    tolerance = stated_tolerance(machine, floor, torque_rms_nm(session))
    return replace(noise, effective=effective, floor=floor, tolerance=tolerance)
