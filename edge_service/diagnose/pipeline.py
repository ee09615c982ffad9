"""Pipeline of a diagnosis: from a session to what causes its gap, and how far that shrinks it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from ..models.effects.effect import Effect
from ..models.effects.registry import effects
from ..models.machine import Machine
from .estimation.waterfall import waterfall
from .localisation.places import where
from .preload.beside_loss import Loss, beside, with_loss
from .result import ChannelGap, Diagnosis, NamedEffect, Verdict
from .selection.preparation import prepare_selection
from .selection.selected_model import select_model
from .session.session import TORQUE_GAP, Session
from .validation.assessment import assess_causes
from .validation.replay import replay
from .validation.verdict import channel_gaps, conclude

__all__ = ["ChannelGap", "Diagnosis", "NamedEffect", "Verdict", "diagnose_session"]

ALL_MOTIONS = "full"
"""Motion that decides what none shorter is known to decide."""


def diagnose_session(
    session: Session,
    machine: Machine,
    library: Sequence[Effect] | None = None,
    progress: Callable[[str], None] = lambda _line: None,
    loss: Loss | None = None,
) -> Diagnosis:
    """Diagnose one session.

    Args:
        session: runs of one axis, checked by `session.data_check`, as rows of torque and position.
        library: effects that may be named; all of them unless given.
        loss: of the preload, where it is known; what else there is is sought beside it.
    """
    whole = session
    session = whole if loss is None else beside(whole, loss)
    progress("signatures of the library")
    library = tuple(effects().values()) if library is None else library
    library = tuple(each for each in library if not each.is_fault)
    problem = prepare_selection(session, machine, library)  # candidates, noise and priors

    progress("sets of effects")
    selected = select_model(session, machine, problem)  # stepwise, exhaustive, posterior

    progress("values and held-out motion")
    assessment = assess_causes(selected)  # estimation and cross validation of what is material
    contributions = assessment.contributions
    gap = channel_gaps(assessment)
    conclusion = conclude(assessment, gap)

    floors = {name: each.noise_floor for name, each in gap.items()}
    rows_after = {
        name: replace(rows, gap=contributions.left[name]) for name, rows in session.channels.items()
    }
    channel_of = contributions.channel_of
    if loss is not None:
        channel_of = {loss.course.effect.name: TORQUE_GAP, **channel_of}
    course = None if loss is None else loss.course
    found = Diagnosis(
        verdict=conclusion.verdict,
        gap=gap,
        where=tuple(where(session.channels, floors)),
        where_after=tuple(where(rows_after, floors)),
        effects=conclusion.effects,
        unexplained=max(assessment.selected.unexplained.values(), default=0.0),
        next_motion=ALL_MOTIONS if conclusion.verdict is Verdict.AMBIGUOUS else None,
        left=contributions.left,
        waterfall=waterfall(session, contributions.by_effect),
        nearest=conclusion.nearest,
        replay=replay(machine, assessment.folds, channel_of, floors, course),
        caveats=conclusion.caveats,
        is_blind=conclusion.is_blind,
        suspects=assessment.suspects,
    )
    return found if loss is None else with_loss(found, whole, session, loss)
