"""`edge-service diagnose`: recordings and a machine file in, the diagnosis as three files out.

What `doctor` and the live estimator see in the same recordings are its witnesses.
"""

import json
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...atomic import write_whole
from ...checks.examination import check_plausibility
from ...checks.finding import Finding
from ...checks.session import DataCheck, check_data
from ...checks.torque import WIDE
from ...command_answer import Answer, progress
from ...config import ConfigError, load_machine
from ...diagnose.candidates.regressors import unobservable
from ...diagnose.experiment import propose
from ...diagnose.pipeline import diagnose_session, learnable, ranked
from ...diagnose.preload import (
    PreloadReading,
    diagnose_beside_loss,
    fresh_screw,
    known_loss,
    with_missing_drag,
)
from ...diagnose.residual.reference import Reference, healthy_machine, healthy_model
from ...diagnose.result import ChannelGap, Diagnosis, NamedEffect, ReplayStatus, Verdict, withheld
from ...diagnose.session.session import CHANNEL_UNITS, TORQUE_GAP, rigid_baseline
from ...estimate.mixture.estimator import MixturePreloadEstimator
from ...messages.estimate import PreloadEstimate
from ...messages.samples import ANGLE, TABLE_POSITION, SampleFrame
from ...models.effects.effect import Effect
from ...models.effects.learned import model_effects
from ...models.effects.registry import effects, fault, get_effect
from ...models.machine import Machine
from ...models.motions.registry import MotionError
from ...nodes.stages import make_downsampler
from ...regression.run import Run
from ..recordings import examine_within, open_recording, remarks_of
from ..report.diagnosis_page import located, render, summary
from .gap import BadDataError, DiagnosisError, one_line, read_runs, session_of

_FILES = ("augmented.toml", "report.html", "diagnosis.json")
COPIES = "{}: copies or parts of other references, or too short, and so none by themselves"
_TRUST = 0.5
"""Of the probability of an effect, where one that it resembles is seen and not among the causes."""


def diagnose(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path,
    reference: Sequence[Path] = (),
    axis_number: int | None = None,
    without: Sequence[str] = (),
) -> Answer:
    """Write diagnosis.json, augmented.toml and report.html into `out`; returns a summary.

    A run that fails leaves none of them there, not even older ones.

    Raises ConfigError, TraceError, DiagnosisError, BadDataError.
    """
    try:
        stated = machine = load_machine(machine_file, axis_number)
        library = library_without(without)
        text, healthy = machine_file.read_text("utf-8-sig"), None
        if reference:
            machine, healthy = _healthy(machine, reference)
        runs = read_runs(machine, traces)
        names = [path.name for path in traces]
        check, findings = _checked(machine, traces, runs)
        if check.faults:
            refused = _bad_data(machine, runs, check)
            _write(out, refused, text, render(machine, names, refused))
            raise BadDataError(
                f"bad data: {'; '.join(check.faults)} (report: {out / 'report.html'})"
            )
        compared, unshown = (runs, []) if healthy is None else healthy.shown(runs)
        whole = session_of(machine, compared)
        session = whole if healthy is None else healthy.beside(whole)
        doubted = [*doubts(machine, runs), *(each for each in findings if each.sentence == WIDE)]
        fresh, lost = fresh_screw(machine), None
        reading, mismatches = preload_reading(machine, traces)
        may_lose = fault() in library
        if may_lose and fresh and reading and reading.is_lost and TORQUE_GAP in session.channels:
            course = known_loss(session, fresh)
            lost = diagnose_beside_loss(session, machine, course, reading, progress, library)
        found = lost or diagnose_session(session, machine, library, progress)
        found = _with_motion(beside_doubts(found, doubted, library), machine)
        found = with_missing_drag(found, fresh, reading) if may_lose and not lost else found
        counted = [] if healthy is None else [each.runs[0].recording for each in healthy.sessions]
        copies = ", ".join(path.name for k, path in enumerate(reference) if k not in counted)
        said = map("doctor: {0.sentence}".format, doubted)
        is_new = mismatches and found.verdict is Verdict.NO_GAP
        verdict = Verdict.UNKNOWN if is_new else found.verdict
        found = found.with_effects(found.effects, verdict, *mismatches)
        unseen, ratio = unobservable(session), machine.transmission_ratio_m_per_rad
        # the file that is written knows of no reference
        plain = session if machine is stated else session_of(stated, read_runs(stated, traces))
        learned = learnable(found, plain)
        told = {
            "where": located(found.where, ratio),
            "not_judged": tuple(unseen),
            "not_judged_reasons": unseen,
            "augmented": tuple(each.name for each in learned),
            "withheld": withheld(found),
            "is_doubted": bool(remarks_of(findings) or doubted),
            "remarks": (*[COPIES.format(copies)] * bool(copies), *check.remarks, *unshown, *said),
            "reference": tuple(reference[k].name for k in counted),
        }
        found = found.model_copy(update=told)
        found = found if healthy is None else healthy.told(found, whole)
        try:
            augmented = augmented_toml(text, learned)
        except ValueError as error:
            raise ConfigError(f"{machine_file}: {error}") from error
        _write(out, found, augmented, render(machine, names, found, session))
        return Answer(summary(found, out, ratio), found)
    except BadDataError:
        raise
    except BaseException:
        for name in _FILES:
            (out / name).unlink(missing_ok=True)
        raise


def library_without(names: Sequence[str]) -> tuple[Effect, ...]:
    """The effects of the library without some. Raises DiagnosisError: it has no such effect."""
    with one_line():
        left_out = [get_effect(name) for name in names]
    return tuple(each for each in effects().values() if each not in left_out)


def _checked(
    machine: Machine, traces: Sequence[Path], runs: Sequence[Run]
) -> tuple[DataCheck, list[Finding]]:
    """Check of a session, and what `doctor` finds: its words come before those of the check."""
    check = check_data(runs, machine.transmission_ratio_m_per_rad, [p.name for p in traces])
    found = examine_within(machine, traces)
    forbidding = tuple(f"{each.sentence}; {each.remedy}" for each in found if each.forbids)
    said = remarks_of(found)
    faults = forbidding or (said if check.faults else ()) or check.faults
    return replace(check, faults=faults, remarks=(*check.remarks, *said)), found


def _bad_data(machine: Machine, runs: Sequence[Run], check: DataCheck) -> Diagnosis:
    gap = {}
    with suppress(DiagnosisError):
        for name, rows in session_of(machine, runs).channels.items():
            unit = CHANNEL_UNITS[name]
            gap[name] = ChannelGap(before=rows.rms, after=rows.rms, noise_floor=None, unit=unit)
    bad = {"verdict": Verdict.BAD_DATA, "replay": ReplayStatus(possible=False, reason="bad data")}
    return Diagnosis(gap=gap, reasons=check.faults, remarks=check.remarks, **bad)


def augmented_toml(machine_text: str, effects: Sequence[NamedEffect]) -> str:
    """The machine file with the accepted effects behind those that it has.

    Raises ValueError: the file writes its effects as one value, to which nothing can be appended.
    """
    blocks = []
    for each in effects:
        for values in each.entries:
            inline = ", ".join(f"{name} = {float(value)!r}" for name, value in values.items())
            blocks.append(f'\n[[effects]]\nname = "{each.name}"\nparameters = {{ {inline} }}\n')
    text = machine_text.rstrip("\n") + "\n" + "".join(blocks)
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"effects: cannot be appended to; write them as [[effects]] ({error})"
        ) from error
    return text


def _healthy(machine: Machine, reference: Sequence[Path]) -> tuple[Machine, Reference]:
    """The machine as healthy recordings show it, with their gap. Raises DiagnosisError."""
    runs = read_runs(machine, reference)
    shown = healthy_model(machine, runs, rigid_baseline(machine))
    runs = read_runs(shown, reference)
    if faults := _checked(machine, reference, runs)[0].faults:
        raise DiagnosisError(f"reference: {'; '.join(faults)}")
    return shown, healthy_machine(runs, rigid_baseline(shown), model_effects(shown))


def _with_motion(found: Diagnosis, machine: Machine) -> Diagnosis:
    """The diagnosis with the motion that tells its tied effects apart best, or all of them."""
    tied = {name for each in found.effects for name in each.tied if len(each.tied) > 1}
    tied = tied or {each.name for each in found.effects if each.entries}
    if found.verdict is not Verdict.AMBIGUOUS or len(tied) < 2:
        return found
    values = {each.name: each.entries[0] for each in found.effects if each.entries}
    with suppress(MotionError):
        for best in propose(machine, tied, values)[:1]:
            return found.model_copy(update={"next_motion": best.motion})
    return found


def _write(out: Path, found: Diagnosis, augmented: str, page: str) -> None:
    document = found.model_dump(mode="json", by_alias=True)
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    for name, content in zip(_FILES, (augmented, page, text), strict=True):
        write_whole(out / name, content)


def doubts(machine: Machine, runs: Sequence[Run]) -> list[Finding]:
    """Findings of `doctor` about the two encoders that are no good ones."""
    ratio = machine.transmission_ratio_m_per_rad
    frames = []
    for run in runs:
        if run.transmission_m is not None and not run.misses_acceleration:
            angle_rad = run.motion.angle_rad
            channels = {ANGLE: angle_rad, TABLE_POSITION: run.transmission_m + ratio * angle_rad}
            frames.append(SampleFrame(run.motion.time_s, channels))
    found = check_plausibility(machine, frames) if frames else []
    return [each for each in found if each.is_doubtful and each.name != "rate"]


def beside_doubts(
    found: Diagnosis, doubted: Sequence[Finding], library: Sequence[Effect]
) -> Diagnosis:
    """Diagnosis that names what `doctor` sees by itself with what it may pass for.

    An effect that the causes lack, such as a lag of an encoder, leaves those that may be named in
    its place unsure, and tied with it; rows that may be filled in do so with a vibration.
    """
    named, seen = {each.name for each in found.effects}, {each.name for each in doubted}
    changed = list(found.effects)
    for k, each in enumerate(changed) if "torque" in seen else ():
        if each.channel == TORQUE_GAP and not each.entries:
            changed[k] = each.model_copy(update={"probability": _TRUST * each.probability})
    for effect in library:
        name, confirmed = effect.name, effect.confirmation
        if not confirmed or confirmed.check not in seen or name in named:
            continue
        for k, each in enumerate(changed):
            if each.entries and get_effect(each.name).kind in confirmed.resembled_by:
                less = {"probability": _TRUST * each.probability, "tied": (*each.tied, name)}
                changed[k] = each.model_copy(update=less)
    if changed == list(found.effects):
        return found
    verdict = Verdict.AMBIGUOUS if found.verdict is Verdict.EXPLAINED else found.verdict
    return found.with_effects(ranked(changed), verdict)


def preload_reading(
    machine: Machine, traces: Sequence[Path]
) -> tuple[PreloadReading | None, tuple[str, ...]]:
    """Last number, what holds the intervals of all recordings, and doubts about the model."""
    fresh, known = machine.fresh_preload_percent, machine.commissioned
    if known is None or fresh is None or fresh_screw(machine) is None:
        return None, ()
    ends = [_last(machine, path) for path in traces]
    said = (f"the running service says of it: {each}" for end in ends for each in end.reasons)
    mismatches = tuple(dict.fromkeys(each for each in said if "model_mismatch" in each))
    read = [(e.preload_percent, e.low, e.high) for e in ends if e.preload_percent is not None]
    if not read:
        return None, mismatches
    values, lows, highs = (100.0 / fresh * np.array(read, np.float64)).T.tolist()
    two = known.transmission is not None
    return PreloadReading(values[-1], min(lows), max(highs), two_encoders=two), mismatches


def _last(machine: Machine, path: Path) -> PreloadEstimate:
    downsampler, estimator = make_downsampler(machine), MixturePreloadEstimator(machine)
    with open_recording(machine, path) as frames:
        for frame in frames:
            for block in downsampler.push(frame):
                estimator.update(block)
    return estimator.estimate()
