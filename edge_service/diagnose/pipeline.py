"""Pipeline of a diagnosis: from a session to what causes its gap, and how far that shrinks it."""

from collections.abc import Callable, Sequence

from ..models.effects.effect import ActiveEffect, Effect
from ..models.effects.registry import effects
from ..models.machine import Machine
from .result import Diagnosis
from .selection.posterior import select_model
from .selection.problem import SelectionProblem
from .session.session import Session
from .validation.assessment import assess_causes
from .validation.verdict import conclude


def diagnose_session(
    session: Session,
    machine: Machine,
    library: Sequence[Effect] | None = None,
    progress: Callable[[str], None] = lambda _line: None,
    loss: ActiveEffect | None = None,
) -> Diagnosis:
    """Diagnose one session.

    Args:
        session: runs of one axis, checked, as rows of torque and position.
        library: effects that may be named; all of them unless given.
        loss: of the preload that the session's gap has no part of; it is replayed with the causes.
    """
    library = tuple(effects().values()) if library is None else library
    searched = [each for each in library if not each.is_fault]
    progress("signatures of the library")
    problem = SelectionProblem.of_session(session, machine, searched)  # candidates, noise, priors
    progress("sets of effects")
    posterior = select_model(problem)  # stepwise, exhaustive, weighed
    progress("values and held-out motion")
    assessment = assess_causes(posterior)  # estimation and cross validation of what is material
    return conclude(assessment, loss)
