"""`edge-service diagnose`: recordings and a machine file in, the diagnosis as three files out."""

import json
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ...atomic import replaced_file
from ...checks.session import DataCheck, check_data
from ...command_answer import Answer
from ...config import ConfigError, load_machine
from ...diagnose.candidates.regressors import unobservable
from ...diagnose.experiment import propose
from ...diagnose.pipeline import diagnose_session
from ...diagnose.preload import diagnose_beside_loss, fresh_screw, known_loss, with_missing_drag
from ...diagnose.residual.reference import Reference, healthy_machine, healthy_model
from ...diagnose.result import (
    ChannelGap,
    Diagnosis,
    NamedEffect,
    ReplayStatus,
    Verdict,
    learnable,
    withheld,
)
from ...diagnose.session.session import CHANNEL_UNITS, TORQUE_GAP, rigid_baseline
from ...messages.interval import printed
from ...models.effects.learned import model_effects
from ...models.machine import Machine
from ...models.motions.registry import MotionError
from ...regression.run import Run
from ..recordings import Progress, examine, silent
from ..report.diagnosis_page import render
from .gap import BadDataError, DiagnosisError, read_runs, session_of
from .witnesses import beside_doubts, doubts, preload_reading

_FILES = ("augmented.toml", "report.html", "diagnosis.json")


def diagnose(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path,
    progress: Progress = silent,
    reference: Sequence[Path] = (),
    axis_number: int | None = None,
) -> Answer:
    """Write diagnosis.json, augmented.toml and report.html into `out`; returns a summary.

    A run that fails leaves none of them there, not even older ones.

    Raises ConfigError, TraceError, DiagnosisError, BadDataError.
    """
    try:
        machine = load_machine(machine_file, axis_number)
        return _diagnosed(machine, machine_file, traces, out, progress, reference)
    except BadDataError:
        raise
    except BaseException:
        for name in _FILES:
            (out / name).unlink(missing_ok=True)
        raise


def _diagnosed(
    machine: Machine,
    machine_file: Path,
    traces: Sequence[Path],
    out: Path,
    progress: Progress,
    reference: Sequence[Path],
) -> Answer:
    text, healthy = machine_file.read_text("utf-8"), None
    if reference:
        machine, healthy = _healthy(machine, reference, progress)
    runs = read_runs(machine, traces, progress)
    names = [path.name for path in traces]
    check = _checked(machine, traces, runs)
    if check.faults:
        refused = _bad_data(machine, runs, check.faults, check.remarks)
        _write(out, refused, text, render(machine, names, refused))
        raise BadDataError(f"bad data: {'; '.join(check.faults)} (report: {out / 'report.html'})")
    session = session_of(machine, runs)
    if healthy is not None:
        session = healthy.beside(session)
    doubted = doubts(machine, runs)
    fresh, reading, lost = fresh_screw(machine), preload_reading(machine, traces), None
    if fresh and reading and reading.is_lost and TORQUE_GAP in session.channels:
        course = known_loss(session, fresh)
        lost = diagnose_beside_loss(session, machine, course, reading, progress)
    found = lost or diagnose_session(session, machine, progress=progress)
    found = _with_motion(beside_doubts(found, doubted), machine)
    found = found if lost else with_missing_drag(found, fresh, reading)
    unseen = unobservable(session)
    stated = {
        "not_judged": tuple(unseen),
        "not_judged_reasons": unseen,
        "augmented": tuple(each.name for each in learnable(found)),
        "withheld": withheld(found),
        "remarks": (*check.remarks, *(f"doctor: {each.sentence}" for each in doubted)),
        "reference": tuple(path.name for path in reference),
    }
    found = found.model_copy(update=stated)
    try:
        augmented = augmented_toml(text, learnable(found))
    except ValueError as error:
        raise ConfigError(f"{machine_file}: {error}") from error
    _write(out, found, augmented, render(machine, names, found, session))
    return Answer(_summary(found, out), found)


def _checked(machine: Machine, traces: Sequence[Path], runs: Sequence[Run]) -> DataCheck:
    """Check of a session: what `doctor` forbids comes first, in its words."""
    names = [path.name for path in traces]
    check = check_data(runs, machine.transmission_ratio_m_per_rad, names)
    forbidding = tuple(f"{e.sentence}; {e.remedy}" for e in examine(machine, traces) if e.forbids)
    return replace(check, faults=forbidding or check.faults)


def _bad_data(
    machine: Machine, runs: Sequence[Run], reasons: tuple[str, ...], remarks: tuple[str, ...]
) -> Diagnosis:
    """Document where the data do not allow a diagnosis."""
    gap = {}
    with suppress(DiagnosisError):
        for name, rows in session_of(machine, runs).channels.items():
            unit = CHANNEL_UNITS[name]
            gap[name] = ChannelGap(before=rows.rms, after=rows.rms, noise_floor=None, unit=unit)
    status = ReplayStatus(possible=False, reason="bad data")
    return Diagnosis(
        verdict=Verdict.BAD_DATA, gap=gap, reasons=reasons, remarks=remarks, replay=status
    )


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


def _healthy(
    machine: Machine, reference: Sequence[Path], progress: Progress
) -> tuple[Machine, Reference]:
    """The machine as healthy recordings show it, with their gap. Raises DiagnosisError."""
    runs = read_runs(machine, reference, progress)
    shown = healthy_model(machine, runs, rigid_baseline(machine))
    runs = read_runs(shown, reference, progress)
    faults = _checked(machine, reference, runs).faults
    if faults:
        raise DiagnosisError(f"reference: {'; '.join(faults)}")
    return shown, healthy_machine(runs, rigid_baseline(shown), model_effects(shown))


def _with_motion(found: Diagnosis, machine: Machine) -> Diagnosis:
    """The diagnosis with the motion that tells its tied effects apart best, or all of them."""
    tied = {name for each in found.effects for name in each.tied if len(each.tied) > 1}
    tied = tied or {each.name for each in found.effects}
    if found.verdict is not Verdict.AMBIGUOUS or len(tied) < 2:
        return found
    values = {each.name: each.entries[0] for each in found.effects if each.entries}
    try:
        best = propose(machine, tied, values)[:1]
    except MotionError:
        return found
    return found.model_copy(update={"next_motion": best[0].motion}) if best else found


def _write(out: Path, found: Diagnosis, augmented: str, page: str) -> None:
    document = found.model_dump(mode="json", by_alias=True)
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    for name, content in zip(_FILES, (augmented, page, text), strict=True):
        with replaced_file(out / name) as file:
            file.write(content)


def _summary(found: Diagnosis, out: Path) -> str:
    is_part = found.partly and found.verdict is Verdict.EXPLAINED
    lines = [f"verdict: {'partly ' if is_part else ''}{found.verdict.value}"]
    lines += [
        f"{name}: {each.before:.3g} {each.unit} before, {each.after:.3g} after, "
        f"{each.noise_floor:.3g} floor ({each.floor_source}), {each.tolerance:.3g} tolerated"
        for name, each in found.gap.items()
    ]
    for each in found.effects:
        shrink = each.shrink
        value, low, high = printed(100.0 * shrink.estimate, 100.0 * shrink.low, 100.0 * shrink.high)
        shrinks = f"shrinks {each.channel} by {value} % ({low} to {high})"
        lines.append(f"{each.name}: probability {each.probability:.3f}, {shrinks}")
    lines += [f"but {each}" for each in found.caveats]
    unsure = [e.name for e in found.effects if e.name not in found.augmented + found.withheld]
    kinds = {
        "in augmented.toml": found.augmented,
        "not in augmented.toml, for it is not sure": unsure,
        "not in augmented.toml, for a model should not learn a fault": found.withheld,
    }
    lines += [f"{words}: {', '.join(names)}" for words, names in kinds.items() if names]
    if found.next_motion:
        document = out / "diagnosis.json"
        lines.append(f"to decide ({found.next_motion}): edge-service motion next {document}")
    return "\n".join([*lines, f"report: {out / 'report.html'}"])
