"""Preload that is lost: what the estimator knows of it, and what it does to a gap.

A loss beyond doubt is taken off first, if the torque asks for it, and the rest is sought beside it.
Lower friction that nothing else explains may be a lost preload or a lubricant: both are named.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from ..messages.samples import Floats
from ..models.effects.effect import ActiveEffect, Effect, Term
from ..models.effects.library.preload_loss import lost_percent
from ..models.effects.registry import active_effect, error_of, fault
from ..models.machine import Machine
from ..models.plant.from_machine import table_mass
from ..regression.linear import LinearFit, least_squares
from .pipeline import beside, diagnose_session
from .result import SURE, SUREST, Diagnosis, NamedEffect, ParameterValue, Verdict
from .session.session import TORQUE_GAP, Session, parameter_tolerances
from .validation.assessment import on_other_motion

SURELY_LOST_PERCENT = 10.0
"""Loss that the whole interval of the estimator must exceed (assumption): less is no fault yet."""
_ENDS = 12
_LEAST_GAIN = 0.9
"""Of what an even loss leaves: a fall within the recording must leave less to be one."""
_SIGMAS = 2.0 * NormalDist().inv_cdf(0.975)
"""Width of a 95 % interval in standard deviations."""
_EVEN = 0.5
"""Nothing here tells a lost preload from friction that is less for another reason."""
CAVEAT = (
    "the lower friction may mean that the screw has lost preload, or that the lubricant rubs "
    "less: `edge-service estimate` can tell which on an axis commissioned with both encoders"
)
NOT_ASKED = (
    "the estimator reads a loss of preload from the two encoders that the torque, with all that is "
    "named, does not show: play, a spring or a lead may give in the same way"
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
    nut_m_per_n, stated = 0.0, machine.model.nut_stiffness_n_per_m
    learned = None if machine.commissioned is None else machine.commissioned.transmission
    if stated is not None:
        nut_m_per_n = 1.0 / stated.value
    elif learned is not None:
        stretch_s2 = learned.nut_share * learned.stretch_per_acceleration_s2
        nut_m_per_n = stretch_s2 / table_mass(machine)
    fresh = {"fresh_drag_nm": drag.value, "fresh_percent": percent}
    return fresh | {"fresh_nut_m_per_n": nut_m_per_n}


@dataclass(frozen=True, slots=True)
class PreloadReading:
    """Preload that the estimator reads in the recordings, in percent of fresh (95 %)."""

    value: float
    low: float
    high: float
    two_encoders: bool  # the stretch was a witness, beside the torque

    @property
    def lost(self) -> ParameterValue:
        """Loss in percent of fresh."""
        lost = 100.0 - np.array((self.value, self.high, self.low))
        value, low, high = np.clip(lost, 0.0, 100.0).tolist()
        return ParameterValue(value=value, low=low, high=high, unit="%")

    @property
    def is_lost(self) -> bool:
        """Loss beyond doubt; friction alone never shows one."""
        return self.two_encoders and 100.0 - self.high > SURELY_LOST_PERCENT

    @property
    def probability(self) -> float:
        """Probability of a loss that matters."""
        sigma = max(self.high - self.low, 1e-3) / _SIGMAS
        return NormalDist().cdf((100.0 - SURELY_LOST_PERCENT - self.value) / sigma)

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
) -> Diagnosis | None:
    """Diagnose what a session has beyond a loss of known course; None if not asked for."""
    if asked_by_torque(session, machine, course) <= _EVEN:
        return None
    modelled = (*session.modelled, course)
    others = session.beside(Session.of_runs(session.runs, session.baseline, modelled))
    rest = diagnose_session(others, machine, library, progress, course)
    probability = reading.probability * asked_by_torque(session, machine, course, rest.effects)
    if probability <= _EVEN:
        return None
    rows, left = session.channels[TORQUE_GAP], rest.series.left[TORQUE_GAP]
    made = rows.gap - others.channels[TORQUE_GAP].gap
    name = course.effect.name
    named = NamedEffect(
        name=name,
        channel=TORQUE_GAP,
        probability=min(probability, SUREST),
        tied=(name,),
        shrink=on_other_motion(replace(rows, gap=left + made), [left]),
        replay=rest.series.loss,
        parameters={"lost_percent": reading.lost},
        entries=(dict(course.values),),
    )
    sure = Verdict.EXPLAINED if probability >= SURE else Verdict.AMBIGUOUS
    verdict = rest.verdict if rest.verdict is Verdict.AMBIGUOUS else sure
    changes = {"verdict": verdict, "partly": rest.partly or rest.verdict is Verdict.UNKNOWN}
    return beside(rest, [named], session).model_copy(update=changes)


def asked_by_torque(
    session: Session, machine: Machine, course: ActiveEffect, named: Sequence[NamedEffect] = ()
) -> float:
    """Probability of a loss that matters by the torque alone, fitted with all that is named."""
    causes = [active_effect(each.name, values) for each in named for values in each.entries]
    parts = [session.signature(TORQUE_GAP, e.effect, e.values) for e in (course, *causes)]
    rows = session.channels[TORQUE_GAP]
    lost = float(np.mean(lost_percent(course.values, rows.variables["time_s"])))
    fit = _fitted([*parts, *_beside(session)], rows.gap)
    tolerance_nm = parameter_tolerances(machine)[error_of(Term.COULOMB)]
    known = 100.0 * tolerance_nm / course.values["fresh_drag_nm"]
    sigma = math.hypot(lost * math.sqrt(fit.covariance[0, 0]), known) if lost else known
    return NormalDist().cdf((fit.coefficients[0] * lost - SURELY_LOST_PERCENT) / sigma)


def _fitted(columns: Sequence[Floats], gap: Floats) -> LinearFit:
    return least_squares([str(k) for k in range(len(columns))], np.column_stack(columns), gap)


def _beside(session: Session) -> tuple[Floats, Floats, Floats]:
    """Columns of what may be off in the torque beside its Coulomb level, (n,) each."""
    speed = session.column(TORQUE_GAP, lambda motion: motion.speed_rad_s)
    acceleration = session.channels[TORQUE_GAP].variables["motor_acceleration_rad_s2"]
    return speed, np.ones(len(speed)), acceleration


def known_loss(session: Session, fresh: Mapping[str, float]) -> ActiveEffect:
    """Loss of preload whose end and course fit the torque best: lost before, or at an even rate."""
    rows = session.channels[TORQUE_GAP]
    way = session.column(TORQUE_GAP, lambda motion: motion.direction)
    time_s, beside = rows.variables["time_s"], _beside(session)
    drag = fresh["fresh_drag_nm"] / 100.0
    even = _fitted([-drag * way, *beside], rows.gap)
    best, values = _LEAST_GAIN * even.residual_std**2, {"lost_percent": float(even.coefficients[0])}
    for end_s in np.linspace(time_s.min(), time_s.max(), _ENDS + 1)[1:].tolist():
        falling = drag * way * np.maximum(end_s - time_s, 0.0)
        fit = _fitted([-drag * way, falling, *beside], rows.gap)
        lost, rate = fit.coefficients[:2].tolist()
        if fit.residual_std**2 < best and rate > 0.0:
            best = fit.residual_std**2
            values = {"lost_percent": lost, "percent_per_s": rate, "until_s": end_s}
    values["lost_percent"] = float(np.clip(values["lost_percent"], 0.0, 100.0))
    return active_effect(fault().name, {**values, **fresh})


def with_missing_drag(
    found: Diagnosis, fresh: Mapping[str, float] | None, reading: PreloadReading | None
) -> Diagnosis:
    """Diagnosis that names loss of preload, first, where it may be what lowers the drag.

    Args:
        fresh: values of the fresh screw; without them no effect is changed.
        reading: of the estimator, where it has one.
    """
    if reading is not None and reading.is_lost:
        found = found.with_effects(found.effects, found.verdict, NOT_ASKED)
    drag = next((e for e in found.effects if e.name == error_of(Term.COULOMB)), None)
    change = None if drag is None else next(iter(drag.parameters.values()), None)
    if drag is None or change is None or change.low is None or not (change.high or 0.0) < 0.0:
        return found
    if fresh is None:
        return found.with_effects(found.effects, found.verdict, NOT_STATED)
    per_nm = -100.0 / fresh["fresh_drag_nm"]
    value, low, high = (per_nm * each for each in (change.value, change.high or 0.0, change.low))
    if low > 100.0 or (reading is not None and reading.is_there):  # or more than the screw has
        return found
    name, value = fault().name, min(value, 100.0)
    lost = ParameterValue(value=value, low=min(low, 100.0), high=min(high, 100.0), unit="%")
    entries = (fault().complete({"lost_percent": value, **fresh}),)
    changes: dict[str, object] = {"name": name, "parameters": {"lost_percent": lost}}
    probability, both = _EVEN * drag.probability, (name, drag.name)
    changes |= {"probability": probability, "tied": both, "entries": entries}
    named, tied = (drag.model_copy(update=x) for x in (changes, {"tied": (*drag.tied, name)}))
    others = (tied if each is drag else each for each in found.effects)
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    return found.with_effects((named, *others), verdict, CAVEAT)
