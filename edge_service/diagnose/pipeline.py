"""Pipeline of a diagnosis: from a session to what causes its gap, and how far that shrinks it."""

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import NormalDist

import numpy as np

from ..models.effects.effect import ActiveEffect, Effect
from ..models.effects.registry import disturbance, effects
from ..models.machine import Machine
from ..regression import FALSE_ALARMS, chance_of_misfit
from .candidates.regressors import UNKNOWN
from .localisation import where
from .residual.noise import LEAST_EFFECTIVE, healthy_gap, steps_nm
from .residual.vibration import Vibration, strongest_vibration
from .result import (
    NO_HARM,
    SURE,
    ChannelGap,
    Diagnosis,
    Misfit,
    NamedEffect,
    ReplayStatus,
    Series,
    Unexplained,
    Verdict,
    withheld,
)
from .selection.posterior import select_model
from .selection.problem import SelectionProblem
from .session.session import CHANNEL_UNITS, CHANNEL_WORDS, TORQUE_GAP, Session, rms
from .validation.assessment import Assessment, assess_causes
from .validation.replay import replay

BLIND_TRUST = 0.5
"""Of the probability of an effect in a torque that is mostly noise: some entry follows noise; or
where a vibration has most of the gap, for it may shake the axis itself."""
BLIND_SHARE, NOISY_SHARE = 0.5, 0.05
"""Of the torque: a floor beyond the first hides faults as great; beyond the second it is told."""
COARSE = "torque: it comes in steps greater than its noise, and rows that keep a value are left out"
OFF = (
    "{} would have to be {:.0f} tolerances off, those of the machine file or of a healthy drive: "
    "look at that value and its tolerance, or give healthy recordings (`--reference`)"
)
ALLOWED = "the values in the machine file have tolerances that allow as much"
IMPRECISE = 0.1
"""Of the gap: a remainder up to it may be but the way in which an entry simplifies its effect."""
OFTEN = 0.5
"""Part of the time: what oscillates less often, where a force acts for a while, is the force's."""
MOST_VIBRATIONS, MUCH = 3, math.sqrt(0.5)  # of the gap: half of its energy
ALL_MOTIONS = "full"
"""Motion that decides what none shorter is known to decide."""


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
    searched = [e for e in (effects().values() if library is None else library) if not e.is_fault]
    progress("what is periodic in time")
    others, shaken = session, list[tuple[Vibration, NamedEffect]]()
    while len(shaken) < MOST_VIBRATIONS and (each := strongest_vibration(others, machine)):
        calmer = each.taken_from(others)
        shaken.append((each, each.as_cause(others, calmer)))
        others = calmer

    def by_effects(of: Session) -> Diagnosis:
        progress("signatures of the library")
        problem = SelectionProblem.of_session(of, machine, searched)  # candidates, noise, priors
        progress("sets of effects")
        posterior = select_model(problem)  # stepwise, exhaustive, weighed
        progress("values and held-out motion")
        return conclude(assess_causes(posterior), loss)  # estimation and cross validation

    found = by_effects(others)
    if not shaken:
        return found
    own, channels = by_effects(session), {vibration.channel for vibration, _ in shaken}
    is_own = all(own.series.least[each] <= found.series.least[each] for each in channels)
    # what follows an axis also where it shakes is no cause beside its own
    if is_own and own.effects and own.verdict is not Verdict.UNKNOWN:
        return own
    return _shaking(found, shaken, session, others)


def _shaking(
    found: Diagnosis,
    shaken: Sequence[tuple[Vibration, NamedEffect]],
    session: Session,
    others: Session,
) -> Diagnosis:
    """Diagnosis of a session from that of what its vibrations leave.

    One that comes and goes beside a force, named or among much that is unknown, is but told.
    """
    calm = {name: rows.rms / session.channels[name].rms for name, rows in others.channels.items()}
    is_unknown, forced = found.verdict is Verdict.UNKNOWN, {x.name for x in found.effects}
    forces = {n for n, x in calm.items() if (is_unknown and x > MUCH) or disturbance() in forced}
    kept = [x for each, x in shaken if each.channel not in forces or each.is_there.mean() > OFTEN]
    named = list({each.channel: each for each in reversed(kept)}.values())  # the greatest
    told = (
        f"{each.channel}: it oscillates at {each.frequency_hz:.3g} Hz with {each.amplitude:.3g} "
        f"{CHANNEL_UNITS[each.channel]} now and then, as a force of cutting does"
        for each, cause in shaken
        if cause not in kept
    )
    less = [
        each.model_copy(update={"probability": BLIND_TRUST * each.probability})
        if kept and calm[each.channel] < MUCH
        else each
        for each in found.effects
    ]
    rest = found.with_effects(less, verdict_of(less, is_unknown=is_unknown))
    found = beside(rest, named, session)
    verdict = Verdict.EXPLAINED if found.verdict is Verdict.NO_GAP else found.verdict
    return found.with_effects(ranked(found.effects), verdict, *told)


def beside(rest: Diagnosis, named: Sequence[NamedEffect], session: Session) -> Diagnosis:
    """Diagnosis of a session from that of what some causes leave, which were known before."""
    gap = {n: x.model_copy(update={"before": session.channels[n].rms}) for n, x in rest.gap.items()}
    places = where(session.channels, {name: each.floor for name, each in gap.items()})
    first, then = dict[str, float](), dict[str, float]()
    for name, known in rest.misfit.per_channel.items() if rest.misfit else ():
        healthy = gap[name].floor ** 2 + (gap[name].tolerance or 0.0) ** 2
        whole = chance_of_misfit(gap[name].before ** 2, healthy, LEAST_EFFECTIVE)
        first[name], then[name] = min(known["p_value"], whole), known["p_value_after"]
    changes = {"gap": gap, "where": tuple(places), "misfit": Misfit.of_channels(first, then)}
    return rest.model_copy(update=changes | {"effects": (*named, *rest.effects)})


def ranked(effects: Sequence[NamedEffect]) -> list[NamedEffect]:
    """The most probable first; of those as probable, what shrinks the gap most."""
    return sorted(effects, key=lambda each: (-each.probability, -each.shrink.estimate))


def conclude(assessment: Assessment, loss: ActiveEffect | None = None) -> Diagnosis:
    """Reach the verdict on assessed effects, and replay them; with them, a `loss` known before."""
    posterior, contributions = assessment.posterior, assessment.contributions
    problem, session, left = posterior.problem, posterior.problem.session, contributions.left
    noise = problem.noise
    torque_rms_nm, floor = session.torque_rms_nm, dict(noise.floor)
    if TORQUE_GAP in floor:  # a reference may tell nothing; then the torque itself is unknown
        floor[TORQUE_GAP] = min(floor[TORQUE_GAP], torque_rms_nm)
    blind = TORQUE_GAP in floor and floor[TORQUE_GAP] > BLIND_SHARE * torque_rms_nm
    coarse = 0.0 < floor.get(TORQUE_GAP, 0.0) <= steps_nm(session)
    known = {} if loss is None else {loss.effect.name: TORQUE_GAP}
    channel_of = {**known, **contributions.channel_of}
    replayed = replay(problem.machine, assessment.validation, channel_of, floor, loss)
    found = []
    for each in assessment.effects:
        trust = BLIND_TRUST if (blind or coarse) and each.channel == TORQUE_GAP else 1.0
        changes = {"replay": replayed.effects.get(each.name)}
        found.append(each.model_copy(update=changes | {"probability": trust * each.probability}))
    found = ranked(found)
    blind = blind and all(each.channel == TORQUE_GAP for each in found)
    gap, beside_nuisances = {}, contributions.left_beside_nuisances
    left_rms = {name: min(rms(each), rms(left[name])) for name, each in beside_nuisances.items()}
    bare = problem.fit(())
    left_rms = left_rms if found else dict(bare.rms)  # a healthy axis, not beside what was dropped
    for name, rows in session.channels.items():
        gap[name] = ChannelGap(
            before=rows.rms,
            after=rms(left[name]),
            noise_floor=floor[name],
            floor_source="reference" if name in session.healthy_floor else "recording",
            tolerance=noise.tolerance[name],
            commissioned=healthy_gap(problem.machine).get(name),
            unit=CHANNEL_UNITS[name],
            replayed=replayed.gap.get(name),
        )
    is_unknown = blind or assessment.is_unknown
    stretched = problem.stretched(bare) if posterior.exceeding else {}
    chance = {name: noise.chance(name, bare.rms[name]) for name in gap}
    for tolerances in stretched.values() if TORQUE_GAP in posterior.exceeding else ():
        chance[TORQUE_GAP] = min(chance[TORQUE_GAP], 2.0 * NormalDist().cdf(-tolerances))
    after = {name: noise.chance(name, left_rms[name]) for name in gap} if found else chance
    misfit = Misfit.of_channels(chance, after)
    unclaimed = gap.keys() - {each.channel for each in found}
    is_open = any(_exceeds(gap[name], left_rms[name]) for name in unclaimed)
    is_unknown |= not found and (is_open or misfit.p_value < FALSE_ALARMS)
    shares = problem.noise.unexplained_shares(session, left_rms)
    unexplained = max([*posterior.unexplained.values(), *(shares[name] for name in unclaimed)])
    suspected = [*(each.name for each in found), *sorted(posterior.best.material - {UNKNOWN})]
    doubted = assessment.misattributed
    is_known = any(e.is_known and e.channel not in doubted for e in found)
    partly = is_known and is_unknown
    verdict = Verdict.EXPLAINED if partly else verdict_of(found, is_unknown=is_unknown)
    validation, causes = assessment.validation, contributions.channel_of
    fitted = [each.active(causes) for each in (validation.values, *validation.folds)]
    lost = replayed.effects.get(next(iter(known), ""))
    off = [OFF.format(*each) for each in stretched.items() if verdict is Verdict.UNKNOWN]
    return Diagnosis(
        verdict=verdict,
        partly=partly or (is_known and is_open),
        misfit=misfit,
        gap=gap,
        where=tuple(where(session.channels, floor)),
        effects=tuple(found),
        unexplained=Unexplained(
            share=unexplained,
            nearest=next(iter(suspected), None) if verdict is Verdict.UNKNOWN else None,
        ),
        next_motion=ALL_MOTIONS if verdict is Verdict.AMBIGUOUS else None,
        waterfall=contributions.waterfall(),
        caveats=(*[COARSE] * coarse, *caveats_of(gap, left_rms, torque_rms_nm, verdict), *off),
        replay=ReplayStatus(possible=not replayed.problem, reason=replayed.problem or None),
        # noise of the torque is no greater than the torque; a gap may be
        is_blind=blind and gap[TORQUE_GAP].before <= torque_rms_nm,
        series=Series(left, replayed.series, lost, fitted, left_rms),
    )


def verdict_of(found: Sequence[NamedEffect], *, is_unknown: bool) -> Verdict:
    """Verdict on some causes, none or more."""
    if is_unknown:
        return Verdict.UNKNOWN
    if not found:
        return Verdict.NO_GAP
    if any(each.probability < SURE or len(each.tied) > 1 for each in found):
        return Verdict.AMBIGUOUS
    return Verdict.EXPLAINED


def caveats_of(
    gap: Mapping[str, ChannelGap], left: Mapping[str, float], torque_nm: float, verdict: Verdict
) -> tuple[str, ...]:
    """Lines about what the verdict leaves open, from root mean squares, by channel.

    `left` by causes and what a healthy axis may have; of the torque in motion.
    """
    found = []
    if TORQUE_GAP in gap and gap[TORQUE_GAP].floor > NOISY_SHARE * torque_nm:
        found.append(
            f"{gap[TORQUE_GAP].floor:.3g} of {torque_nm:.3g} N m of torque cannot be predicted "
            "from the motion or from a repeat of it: a fault of that size would go unnoticed"
        )
    for name, each in gap.items():
        unit, scale = ("µm", 1e6) if each.unit == "m" else (each.unit, 1.0)
        spoken, tolerance = CHANNEL_WORDS[name], scale * (each.tolerance or 0.0)
        is_open = verdict is not Verdict.NO_GAP and _exceeds(each, left[name])
        rest = left[name] if is_open else each.before if verdict is Verdict.NO_GAP else each.after
        if verdict is not Verdict.UNKNOWN and _exceeds(each, rest):
            found.append(
                f"{spoken}: {scale * math.sqrt(rest**2 - each.floor**2):.3g} {unit} beyond the "
                f"floor are left, more than the {tolerance:.3g} {unit} tolerated: "
                + ("there may be causes beyond those named" if is_open else ALLOWED)
            )
    return tuple(found)


def _exceeds(gap: ChannelGap, left: float) -> bool:
    """Flag of a root mean square that is left beyond the floor, and is too much for no cause."""
    return left > math.hypot(max(gap.tolerance or 0.0, IMPRECISE * gap.before), gap.floor)


def learnable(found: Diagnosis, session: Session) -> tuple[NamedEffect, ...]:
    """Effects that the model of a session may learn: beyond doubt, and no harm as they are written.

    No gap grows with all of them, where none is named for it beyond the tolerance, nor on blocks
    from which their values are not. What helps only beside another that stays out does so too.
    """

    def growth(some: Sequence[NamedEffect]) -> float:
        names, made, most = {each.name: each.channel for each in some}, [], 0.0
        for fit in found.series.fitted:
            modelled = [*session.modelled, *(each for each in fit if each.effect.name in names)]
            made.append(Session.of_runs(session.runs, session.baseline, modelled))
        for name, rows in session.channels.items():
            written, *others = (each.channels[name].gap for each in made)
            after = max(rms(written), rms(np.choose(session.fold[name], others)))
            tolerated = 0.0 if name in names.values() else found.gap[name].tolerance or 0.0
            most = max(most, after / math.hypot(rows.rms, tolerated) - 1.0)
        return most

    kept_out, some = withheld(found), () if found.verdict is Verdict.UNKNOWN else found.effects
    known = [e for e in some if e.entries and e.is_known and e.name not in kept_out]
    while known and growth(known) > NO_HARM:
        known = min(([e for e in known if e is not each] for each in known), key=growth)
    return tuple(known)
