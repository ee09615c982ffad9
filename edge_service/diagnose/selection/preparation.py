"""Preparation of the selection: noise, healthy priors, and the candidates of a session."""

from collections.abc import Sequence

import numpy as np

from ...models.effects.effect import Effect
from ...models.machine import Machine
from ..candidates.design_matrix import DesignMatrix
from ..candidates.force_pulses import FORCE, ForcePulse, pulses_of_session
from ..candidates.healthy_prior import HealthyPrior, healthy_priors, parameter_priors
from ..candidates.null_shapes import null_shapes
from ..candidates.regressor import CandidateRegressor
from ..session.session import TORQUE_GAP, Session
from .noise import Noise, noise_of_gap
from .observability import is_too_slow
from .problem import SelectionProblem


def prepare_selection(
    session: Session, machine: Machine, library: Sequence[Effect]
) -> SelectionProblem:
    """Pose the selection among the entries of a library that a session could show."""
    searched = [
        each for each in library if each.name != FORCE and not is_too_slow(each.name, session)
    ]
    period_s = float(np.diff(session.runs[0].motion.time_s[:2])[0])
    prior = healthy_priors(machine, period_s, session.baseline.coulomb_nm)
    noise = noise_of_gap(session, machine)
    more: list[CandidateRegressor] = list(null_shapes(session))
    if TORQUE_GAP in session.channels and FORCE in {each.name for each in library}:
        more += _force_pulses(session, prior, noise)
    design = DesignMatrix.of_session(session, prior, searched, more)
    return SelectionProblem(design, noise, parameter_priors(prior))


def _force_pulses(
    session: Session, prior: Sequence[HealthyPrior], noise: Noise
) -> Sequence[ForcePulse]:
    """Forces where the torque, less what a healthy axis may have, has a mean of its own."""
    healthy = SelectionProblem(DesignMatrix.of_session(session, prior, ()), noise, {})
    return pulses_of_session(session, healthy.residuals(session, healthy.fit(()))[TORQUE_GAP])
