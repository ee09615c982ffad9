"""Friction that is missing where nothing tells whether it is the preload's or a lubricant's."""

from collections.abc import Mapping
from dataclasses import replace

from ...models.effects.effect import Term
from ...models.effects.registry import error_of, fault
from ..estimation.estimates import Interval
from ..result import Diagnosis, Verdict
from .known_loss import PreloadReading

_EVEN = 0.5
"""Nothing here tells a lost preload from friction that is less for another reason."""
CAVEAT = (
    "the lower friction may mean that the screw has lost preload, or that the lubricant rubs "
    "less: `edge-service estimate` can tell which on an axis commissioned with both encoders"
)

NOT_STATED = (
    "friction is lower, perhaps because the screw has lost preload: model.preload_n and the "
    "fresh screw's own model.preload_drag_nm in the machine file are needed to judge it"
)


def with_missing_drag(
    found: Diagnosis, fresh: Mapping[str, float] | None, reading: PreloadReading | None
) -> Diagnosis:
    """Diagnosis that names loss of preload, first, where it may be what lowers the drag.

    Args:
        fresh: values of the fresh screw; without them no effect is changed.
        reading: of the estimator, where it has one.
    """
    drag = next((e for e in found.effects if e.name == error_of(Term.COULOMB)), None)
    change = None if drag is None else next(iter(drag.parameters.values()), None)
    if drag is None or change is None or change.high >= 0.0:
        return found
    if fresh is None:
        return replace(found, caveats=(*found.caveats, NOT_STATED))
    lost = _lost(change, fresh["fresh_drag_nm"])
    if lost is None or (reading is not None and reading.is_there):
        return found
    name = fault().name
    named = replace(
        drag,
        name=name,
        probability=_EVEN * drag.probability,
        tied=(name, drag.name),
        parameters={"lost_percent": lost},
        entries=(fault().complete({"lost_percent": lost.value, **fresh}),),
    )
    others = (
        replace(each, tied=(*each.tied, name)) if each is drag else each for each in found.effects
    )
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    caveats = (*found.caveats, CAVEAT)
    return replace(found, verdict=verdict, effects=(named, *others), caveats=caveats)


def _lost(change: Interval, fresh_drag_nm: float) -> Interval | None:
    """Loss that would lower the drag so far, percent of fresh; None where no loss does."""
    per_nm = -100.0 / fresh_drag_nm
    if per_nm * change.high > 100.0:
        return None  # more is missing than the screw has
    value, low, high = (
        min(per_nm * each, 100.0) for each in (change.value, change.high, change.low)
    )
    return Interval(value, low, high, "%")
