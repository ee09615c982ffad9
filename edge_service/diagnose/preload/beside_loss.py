"""Diagnosis beside a loss of preload that is known: the loss first, then what else there is."""

from dataclasses import dataclass, replace

from ...models.effects.effect import ActiveEffect
from ..localisation.places import where
from ..result import Diagnosis, NamedEffect, Verdict
from ..session.session import TORQUE_GAP, Session
from ..validation.shrink import on_other_motion
from .known_loss import PreloadReading

SURE = 0.975
"""Chance that a preload lies below the upper end of its 95 % interval."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Loss of preload beyond doubt: its course by the torque, its size by the estimator."""

    course: ActiveEffect
    reading: PreloadReading


def beside(session: Session, loss: Loss) -> Session:
    """Session with what it has beyond a loss as its gap."""
    modelled = (*session.modelled, loss.course)
    found = Session.of_runs(session.runs, session.baseline, modelled)
    return found if session.healthy is None else session.healthy.beside(found)


def with_loss(rest: Diagnosis, whole: Session, others: Session, loss: Loss) -> Diagnosis:
    """Diagnosis of the rest with the loss before all else.

    Args:
        whole, others: sessions with what the loss makes of the gap, and without.
    """
    floors = {name: each.noise_floor for name, each in rest.gap.items()}
    gap = {name: replace(each, before=whole.channels[name].rms) for name, each in rest.gap.items()}
    return replace(
        rest,
        verdict=Verdict.EXPLAINED if rest.verdict is Verdict.NO_GAP else rest.verdict,
        gap=gap,
        where=tuple(where(whole.channels, floors)),
        effects=(_named(rest, whole, others, loss), *rest.effects),
    )


def _named(rest: Diagnosis, whole: Session, others: Session, loss: Loss) -> NamedEffect:
    rows, left = whole.channels[TORQUE_GAP], rest.left[TORQUE_GAP]
    made = rows.gap - others.channels[TORQUE_GAP].gap
    name = loss.course.effect.name
    return NamedEffect(
        name,
        TORQUE_GAP,
        SURE,
        (name,),
        on_other_motion(replace(rows, gap=left + made), [left]),
        {"lost_percent": loss.reading.lost},
        (loss.course.values,),
    )
