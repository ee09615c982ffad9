"""`edge-service adopt`: propose a machine file from recordings of any kind, with reasons."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ..atomic import write_whole
from ..checks.columns.guess import Known, Understanding
from ..checks.columns.mechanics import (
    Ability,
    Mechanics,
    abilities,
    identify_mechanics,
    steady_friction,
)
from ..checks.columns.names import ColumnName, Quantity
from ..checks.columns.understand import understand
from ..checks.finding import Finding
from ..checks.sampling import clock_of
from ..command_answer import Answer, progress
from ..config import ConfigError, load_machine
from ..messages.samples import CHANNELS, TABLE_POSITION, TIME, TORQUE, ColumnMap, SampleFrame
from ..models.screw.ball_screw import transmission_ratio
from ..recordings.columns import TraceError, there_are
from ..recordings.reader import read_trace
from ..recordings.sinumerik.signals import ControllerAxis
from .machine_text import Ask, asked, machine_text
from .raw_columns import RawColumns, read_columns
from .recordings import examine_within
from .report.page import ESTIMATE, STYLE, write_png

ASKED = ("dynamic_load_rating_n", "preload_n", "nut_stiffness_n_per_m", "table_mass_kg")
_DPI, _POINTS = 90, 20_000


def adopt(
    files: Sequence[Path],
    out: Path,
    axis_number: int | None = None,
    known: Known | None = None,
    name: str = "",
    sheet: Mapping[str, float | str] = {},
    columns: Sequence[str] = (),
    picture: Path | None = None,
    ask: Ask | None = None,
) -> Answer:
    """Write the machine file; returns what was understood.

    Raises ConfigError, TraceError: one line.
    """
    if any(out.resolve() == given.resolve() for given in files):
        raise ConfigError(f"--out {out}: would overwrite a recording")
    progress(f"reading {files[0].name}")
    raw = read_columns(files[0], columns)
    axis, number = raw.axis(files[0], axis_number)
    understood = _understand(raw, axis, known or Known(), ask)
    told: dict[str, Any] = {"columns": _taken(raw.of_axis(axis), understood)}
    told |= {"understood": understood.guesses, "unknown": understood.questions}
    try:
        there = there_are([each.name for each in raw.names])
        frames = [_read(path, understood, number, there) for path in files]
    except TraceError as error:
        error.document = told
        raise
    mechanics = _mechanics(frames, understood)
    named = name or (axis if axis and not axis.isdigit() else "X")
    stated = asked(sheet, ASKED, ask)
    names = [path.name for path in files]
    tables = [f.channels[TABLE_POSITION] for f in frames if TABLE_POSITION in f.channels]
    ends = [end for each in tables for end in (float(np.nanmin(each)), float(np.nanmax(each)))]
    travel = max(ends) - min(ends) if ends else None
    write_whole(out, machine_text(names, understood, mechanics, named, number, stated, travel))
    findings = None
    if understood.lead_m is not None and (mechanics is not None or "inertia_kg_m2" in stated):
        findings = examine_within(load_machine(out), files)
    rate_hz = clock_of([frame.time_s for frame in frames]).rate_hz
    rated = {"dynamic_load_rating_n", "preload_n"} <= stated.keys()
    doubt = next((e.sentence for e in findings or () if e.is_doubtful and e.name == "torque"), "")
    able = abilities(understood.columns, mechanics, rate_hz, has_rating=rated, doubt=doubt)
    if picture is not None:
        _draw(frames[0], names[0], picture)
    return _answer(out, told, understood, mechanics, findings, able, picture)


def _taken(names: Sequence[ColumnName], understood: Understanding) -> list[dict[str, str]]:
    """Each column, the quantity of `--column` that it is taken for (other: not used), its unit."""
    used = {each.column: channel for channel, each in understood.columns.items()}
    used |= {each.minus: "position_error" for each in understood.columns.values() if each.minus}
    currents = {each.name for each in names if each.quantity is Quantity.CURRENT}
    used |= dict.fromkeys(currents & used.keys(), "current")
    return [{"name": e.name, "quantity": used.get(e.name, "other"), "unit": e.unit} for e in names]


def _answer(
    out: Path,
    told: Mapping[str, Any],
    understood: Understanding,
    mechanics: Mechanics | None,
    findings: Sequence[Finding] | None,
    able: Sequence[Ability],
    picture: Path | None,
) -> Answer:
    """The machine file was not examined where `findings` is None."""
    lines = [f"{out}: written", "understood:"]
    for guess in understood.guesses:
        mark = "assumed" if guess.assumed else ""
        lines.append(f"  {mark:<8}{guess.subject}: {guess.words.removeprefix('assumed: ')}")
    for question in understood.questions:
        lines.append(f"  unknown {question.option}: {question.words} ({question.why})")
    found = []
    if mechanics is not None:
        lines.append(f"found, from {mechanics.seconds:.3g} s of motion (95 %):")
        for name, each in mechanics.named().items():
            numbers: dict[str, float | None] = dict.fromkeys(("value", "low", "high"))
            said = f"not determined{each.note and f': {each.note}'}"
            if each.determined:
                numbers = {"value": each.value, "low": each.low, "high": each.high}
                said = f"{each.value:.4g} {each.unit} ({each.low:.4g} to {each.high:.4g})"
            found.append({"name": name} | numbers | {"unit": each.unit})
            lines.append(f"  {name}: {said}")
    doubts = [each for each in findings or () if each.is_doubtful]
    if findings is None:
        lines.append("not examined: the machine file lacks lead_m or inertia_kg_m2")
    else:
        lines.append(f"examined: {len(findings)} checks, {len(doubts)} of them doubtful")
        lines += [f"  {each.name}: {each.sentence}" for each in doubts]
    lines += ["these recordings answer:", *(f"  {each.as_text()}" for each in able)]
    if picture is not None:
        lines.append(f"{picture}: the channels as they were understood")
    document = {"out": str(out), **told, "found": found, "able": able}
    document["motion_s"] = None if mechanics is None else mechanics.seconds
    document["checks"] = None if findings is None else len(findings)
    document["doubts"] = [{"name": each.name, "sentence": each.sentence} for each in doubts]
    document["picture"] = None if picture is None else str(picture)
    return Answer("\n".join(lines), document)


def _understand(raw: RawColumns, axis: str, known: Known, ask: Ask | None) -> Understanding:
    names = raw.of_axis(axis)
    found = understand(names, raw.values, known)
    answered: set[str] = {"--column"}  # is no number
    while ask and (open_ := [each for each in found.questions if each.option not in answered]):
        answered.add(open_[0].option)
        known = known.answered(open_[0], ask(open_[0]))
        found = understand(names, raw.values, known)
    used = {name for each in found.columns.values() for name in (each.column, each.minus)}
    told = [each for each in names if each.quantity is not Quantity.OTHER]
    unused = [each.name for each in told if each.name not in used]
    if unused:
        found.say("columns", f"not needed: {', '.join(unused)}")
    for remark in raw.remarks:
        found.say("file", remark)
    return found


def _read(path: Path, understood: Understanding, number: int | None, there: str) -> SampleFrame:
    """The recording as the proposed columns give it: what any later command will read."""
    found = understood.columns.items()
    columns = {channel: each for channel, each in found if each != ColumnMap(channel)}
    if not any(name in CHANNELS for name in understood.columns):
        what, quantity = (
            ("position", TABLE_POSITION) if TIME in understood.columns else ("clock", TIME)
        )
        said = [f"{path}: no {what} is understood: expected samples of an axis in motion", there]
        said += [f"{e.option} {e.words} ({e.why})" for e in understood.questions]
        said += [each.words for each in understood.guesses if each.subject == "file"]
        raise TraceError("; ".join([*said, f"name it by --column {quantity}=COLUMN:UNIT"]))
    progress(f"reading {path.name}")
    return read_trace(path, columns, axis=ControllerAxis(number, understood.lead_m))


def _mechanics(frames: Sequence[SampleFrame], understood: Understanding) -> Mechanics | None:
    if TORQUE not in understood.columns or understood.lead_m is None:
        return None
    ratio = transmission_ratio(understood.lead_m)
    choice = understood.columns[TORQUE]
    try:
        found = (steady_friction if choice.direction else identify_mechanics)(frames, ratio)
    except ValueError as error:
        understood.say("inertia_kg_m2", f"cannot be told: {error}")
        return None
    if not found.sign_is_told:
        words = "neither inertia nor friction shows its sign; it is left as recorded"
        understood.say(TORQUE, words, assumed=True)
    if found.is_inverted:
        understood.columns[TORQUE] = replace(choice, scale=-choice.scale)
        understood.say(TORQUE, "sign reversed: as recorded, it counts against the motion")
        for frame in frames:
            frame.channels[TORQUE][:] *= -1.0
    return found


def _draw(frame: SampleFrame, title: str, out: Path) -> None:
    if out.suffix != ".png":
        raise ConfigError(f"--plot {out}: expected a name that ends in .png")
    step = len(frame) // _POINTS + 1
    steps = np.diff(frame.time_s, prepend=frame.time_s[:1])
    usual = clock_of([frame.time_s]).period_s
    elapsed = np.cumsum(np.where(steps < 0.0, usual, steps))  # runs on where the clock starts anew
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 0.8 + 1.3 * len(frame.channels)), layout="constrained")
        panels = figure.subplots(len(frame.channels), 1, squeeze=False, sharex=True).flatten()
        for axes, (name, values) in zip(panels, frame.channels.items(), strict=True):
            axes.plot(elapsed[::step], values[::step], color=ESTIMATE, lw=0.8)
            described = CHANNELS[name].description if name in CHANNELS else name
            axes.set_title(f"{name}: {described}", loc="left", fontsize=9)
            axes.set_ylabel(CHANNELS[name].unit if name in CHANNELS else "")
        panels[-1].set_xlabel("time, s")
        figure.suptitle(title, fontsize=10)
    write_png(figure, out, _DPI)
