"""Preload that is lost: what the estimator knows of it, and what it does to a gap.

A loss beyond doubt is taken off first, and what else there is is sought beside it. Lower friction
that nothing else explains may be a lost preload or a lubricant that rubs less: both are named.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..messages.samples import Floats
from ..models.effects.effect import ActiveEffect, Effect, Term
from ..models.effects.registry import error_of, fault
from ..models.machine import Machine
from ..models.plant.from_machine import table_mass
from .localisation import where
from .pipeline import diagnose_session
from .result import Diagnosis, NamedEffect, ParameterValue, Verdict, beside
from .session.session import TORQUE_GAP, Session
from .validation.cross_validation import on_other_motion

SURELY_LOST_PERCENT = 10.0
"""Loss that the whole interval of the estimator must exceed (assumption): less is no fault yet."""
_ENDS = 12
_LEAST_GAIN = 0.9
"""Of what an even loss leaves: a fall within the recording must leave less to be one."""
SURE = 0.975
"""Chance that a preload lies below the upper end of its 95 % interval."""
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


def fresh_screw(machine: Machine) -> Mapping[str, float] | None:
    """Values of a loss of preload that are those of the fresh screw; None where it is not known.

    Of a nut of which nothing is known the compliance is 0.
    """
    percent, drag = machine.fresh_preload_percent, machine.model.preload_drag_nm
    if percent is None or drag is None or drag.value <= 0.0:
        return None
    stated = machine.model.nut_stiffness_n_per_m
    learned = None if machine.commissioned is None else machine.commissioned.transmission
    if stated is not None:
        nut_m_per_n = 1.0 / stated.value
    elif learned is not None:
        stretch_s2 = learned.nut_share * learned.stretch_per_acceleration_s2
        nut_m_per_n = stretch_s2 / table_mass(machine)
    else:
        nut_m_per_n = 0.0
    return {
        "fresh_drag_nm": drag.value,
        "fresh_percent": percent,
        "fresh_nut_m_per_n": nut_m_per_n,
    }


@dataclass(frozen=True, slots=True)
class PreloadReading:
    """Preload that the estimator reads in the recordings, in percent of fresh (95 %).

    Attributes:
        two_encoders: the stretch was a witness, beside the torque.
    """

    value: float
    low: float
    high: float
    two_encoders: bool

    @property
    def lost(self) -> ParameterValue:
        """Loss in percent of fresh."""
        value, low, high = (
            min(max(100.0 - each, 0.0), 100.0) for each in (self.value, self.high, self.low)
        )
        return ParameterValue(value=value, low=low, high=high, unit="%")

    @property
    def is_lost(self) -> bool:
        """Loss beyond doubt; friction alone never shows one."""
        return self.two_encoders and 100.0 - self.high > SURELY_LOST_PERCENT

    @property
    def is_there(self) -> bool:
        """No loss that matters, beyond doubt."""
        return self.two_encoders and 100.0 - self.low < SURELY_LOST_PERCENT


def diagnose_beside_loss(
    session: Session,
    machine: Machine,
    course: ActiveEffect,
    reading: PreloadReading,
    progress: Callable[[str], None] = lambda _line: None,
    library: Sequence[Effect] | None = None,
) -> Diagnosis:
    """Diagnose what a session has beyond a known loss, which comes before all else.

    Args:
        course: of the loss by the torque; its size is the estimator's reading.
    """
    modelled = (*session.modelled, course)
    others = session.beside(Session.of_runs(session.runs, session.baseline, modelled))
    rest = diagnose_session(others, machine, library, progress, course)
    rows, left = session.channels[TORQUE_GAP], rest.series.left[TORQUE_GAP]
    made = rows.gap - others.channels[TORQUE_GAP].gap
    name = course.effect.name
    named = NamedEffect(
        name=name,
        channel=TORQUE_GAP,
        probability=SURE,
        tied=(name,),
        shrink=on_other_motion(replace(rows, gap=left + made), [left]),
        replay=rest.series.loss,
        parameters={"lost_percent": reading.lost},
        entries=(dict(course.values),),
    )
    floors = {name: each.floor for name, each in rest.gap.items()}
    return beside(rest, [named], session, where(session.channels, floors))


def known_loss(session: Session, fresh: Mapping[str, float]) -> ActiveEffect:
    """Loss of preload whose end and course fit the torque best: lost before, or at an even rate."""
    effect = fault()
    rows = session.channels[TORQUE_GAP]
    way = session.column(TORQUE_GAP, lambda motion: motion.direction)
    time_s = rows.variables["time_s"]
    beside = np.column_stack(
        [
            session.column(TORQUE_GAP, lambda m: m.speed_rad_s),
            np.ones(len(way)),
            rows.variables["motor_acceleration_rad_s2"],
        ]
    )
    drag = fresh["fresh_drag_nm"] / 100.0
    level, even = _fitted(np.column_stack([-drag * way, beside]), rows.gap)
    best, values = _LEAST_GAIN * even, {"lost_percent": float(level[0])}
    for end_s in np.linspace(float(time_s.min()), float(time_s.max()), _ENDS + 1)[1:]:
        falling = drag * way * np.maximum(end_s - time_s, 0.0)
        found, left = _fitted(np.column_stack([-drag * way, falling, beside]), rows.gap)
        if left < best and found[1] > 0.0:
            best = left
            values = {"lost_percent": found[0], "percent_per_s": found[1], "until_s": end_s}
    values["lost_percent"] = float(np.clip(values["lost_percent"], 0.0, 100.0))
    known = {name: float(each) for name, each in values.items()}
    return ActiveEffect(effect, effect.complete({**known, **fresh}))


def _fitted(columns: Floats, gap: Floats) -> tuple[Floats, float]:
    """Coefficients of columns (n, p), and the mean square that they leave."""
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    beta = np.linalg.lstsq(columns / scale, gap, rcond=None)[0]
    return beta / scale, float(np.mean((gap - columns / scale @ beta) ** 2))


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
    if drag is None or change is None or change.low is None or not (change.high or 0.0) < 0.0:
        return found
    if fresh is None:
        return found.with_effects(found.effects, found.verdict, NOT_STATED)
    per_nm = -100.0 / fresh["fresh_drag_nm"]
    value, low, high = (per_nm * each for each in (change.value, change.high or 0.0, change.low))
    more_than_the_screw_has = low > 100.0
    if more_than_the_screw_has or (reading is not None and reading.is_there):
        return found
    name, value = fault().name, min(value, 100.0)
    lost = ParameterValue(value=value, low=min(low, 100.0), high=min(high, 100.0), unit="%")
    named = drag.model_copy(
        update={
            "name": name,
            "probability": _EVEN * drag.probability,
            "tied": (name, drag.name),
            "parameters": {"lost_percent": lost},
            "entries": (fault().complete({"lost_percent": value, **fresh}),),
        }
    )
    others = (
        each.model_copy(update={"tied": (*each.tied, name)}) if each is drag else each
        for each in found.effects
    )
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    return found.with_effects((named, *others), verdict, CAVEAT)
