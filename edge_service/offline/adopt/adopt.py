"""`edge-service adopt`: propose a machine file from recordings of any kind, with reasons."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...atomic import replaced_file
from ...checks.columns.guess import Choice, Known, Question, Understanding
from ...checks.columns.mechanics import (
    Ability,
    Mechanics,
    abilities,
    identify_mechanics,
    steady_friction,
)
from ...checks.columns.names import Quantity
from ...checks.columns.understand import understand
from ...command_answer import Answer
from ...config import ConfigError, load_machine
from ...messages.channels import CHANNELS, TABLE_POSITION, TORQUE
from ...messages.samples import SampleFrame
from ...models.screw.ball_screw import transmission_ratio
from ...recordings.columns import ColumnMap, TraceError
from ...recordings.reader import read_trace
from ...recordings.sinumerik.controller_axis import ControllerAxis
from ..examination import examine
from ..recordings import Progress, silent
from .adopted import answer_of
from .channels_picture import write_channels_picture
from .machine_text import SHEET_QUESTIONS, DataSheet, machine_text
from .raw_columns import RawColumns, read_columns

Ask = Callable[[Question], float | None]
"""Asks a person one question; None if they do not know."""
_ASKED_MM = "--lead"


@dataclass(frozen=True, slots=True)
class Request:
    """Wishes and answers of the owner.

    Attributes:
        axis_number: the controller's number of the axis, or its place among the axes of the file.
        columns: `QUANTITY=COLUMN[:UNIT]`.
        picture: file for a picture of the channels.
    """

    files: Sequence[Path]
    out: Path
    axis_number: int | None = None
    known: Known = field(default_factory=Known)
    sheet: DataSheet = field(default_factory=DataSheet)
    columns: Sequence[str] = ()
    picture: Path | None = None


def adopt(request: Request, ask: Ask | None = None, progress: Progress = silent) -> Answer:
    """Write the machine file; returns what was understood.

    Args:
        ask: asks whoever is at the terminal; None if nobody is.

    Raises:
        ConfigError, TraceError: one line.
    """
    if any(request.out.resolve() == given.resolve() for given in request.files):
        raise ConfigError(f"--out {request.out}: would overwrite a recording")
    progress(f"reading {request.files[0].name}")
    raw = read_columns(request.files[0], request.columns)
    axis, number = _axis(request, raw)
    understood = _understand(raw, axis, request.known, ask)
    for remark in raw.remarks:
        understood.say("file", remark)
    frames = [_read(path, understood, number, progress) for path in request.files]
    mechanics = _mechanics(frames, understood)
    sheet = _asked(replace(request.sheet, number=number), ask)
    if request.sheet.name == DataSheet().name and axis and not axis.isdigit():
        sheet = replace(sheet, name=axis)
    names = [path.name for path in request.files]
    text = machine_text(names, understood, mechanics, sheet, _travel(frames))
    with replaced_file(request.out) as file:
        file.write(text)
    findings = (
        None if mechanics is None else examine(load_machine(request.out), request.files, progress)
    )
    able = _abilities(frames, understood, mechanics, sheet)
    if request.picture is not None:
        _draw(frames[0], names[0], request.picture)
    return answer_of(request.out, request.picture, understood, mechanics, findings, able)


def _axis(request: Request, raw: RawColumns) -> tuple[str, int | None]:
    """Axis as the file spells it, and its number; empty and None where it names none."""
    axes = raw.axes
    if not axes:
        return "", None
    numbers = {int(axis) if axis.isdigit() else k + 1: axis for k, axis in enumerate(axes)}
    if request.axis_number is None and len(axes) > 1:
        shown = ", ".join(
            axis if axis == str(number) else f"{number} ({axis})"
            for number, axis in numbers.items()
        )
        raise TraceError(
            f"{request.files[0]}: axes there are: {shown}; expected the number of the one wanted "
            "(--axis-number)"
        )
    number = next(iter(numbers)) if request.axis_number is None else request.axis_number
    if number not in numbers:
        known = ", ".join(map(str, numbers))
        raise TraceError(f"{request.files[0]}: no axis {number}; axes there are: {known}")
    return numbers[number], number if numbers[number].isdigit() else None


def _understand(raw: RawColumns, axis: str, known: Known, ask: Ask | None) -> Understanding:
    names = raw.of_axis(axis)
    found = understand(names, raw.values, known)
    answered: set[str] = set()
    while ask is not None:
        question = next((each for each in found.questions if each.option not in answered), None)
        if question is None:
            break
        answered.add(question.option)
        known = _with_answer(known, question, ask(question))
        found = understand(names, raw.values, known)
    used = {name for each in found.columns.values() for name in (each.column, each.minus)}
    unused = [
        each.name for each in names if each.name not in used and each.quantity is not Quantity.OTHER
    ]
    if unused:
        found.say("columns", f"not needed: {', '.join(unused)}")
    return found


def _asked(sheet: DataSheet, ask: Ask | None) -> DataSheet:
    """The data sheet with what whoever is at the terminal knows of it."""
    if ask is None:
        return sheet
    said = {
        name: ask(question) if getattr(sheet, name) is None else getattr(sheet, name)
        for name, question in SHEET_QUESTIONS.items()
    }
    return replace(
        sheet,
        dynamic_load_rating_n=said["dynamic_load_rating_n"],
        preload_n=said["preload_n"],
        nut_stiffness_n_per_m=said["nut_stiffness_n_per_m"],
        table_mass_kg=said["table_mass_kg"],
    )


def _with_answer(known: Known, question: Question, value: float | None) -> Known:
    if value is None:
        return known
    if question.option == _ASKED_MM:
        return replace(known, lead_m=1e-3 * value)
    if question.option == "--period":
        return replace(known, period_s=value)
    return replace(known, torque_constant=value)


def _read(
    path: Path, understood: Understanding, number: int | None, progress: Progress
) -> SampleFrame:
    """The recording as the proposed columns give it: what any later command will read."""
    columns = {
        channel: ColumnMap(each.column, each.scale, 0.0, each.minus, each.direction)
        for channel, each in understood.columns.items()
        if not each.is_plain(channel)
    }
    positions = [name for name in understood.columns if name in CHANNELS]
    if not positions:
        raise TraceError(f"{path}: {_nothing(understood)}")
    progress(f"reading {path.name}")
    return read_trace(path, columns, axis=ControllerAxis(number, understood.lead_m))


def _nothing(understood: Understanding) -> str:
    """Reason for which no column serves, in one line."""
    asked = "; ".join(f"{each.option}: {each.words}" for each in understood.questions)
    return (
        "no column is understood as a position: expected samples of an axis in motion"
        f"{f' ({asked})' if asked else ''}; figures of single days are no recording"
    )


def _mechanics(frames: Sequence[SampleFrame], understood: Understanding) -> Mechanics | None:
    if TORQUE not in understood.columns or understood.lead_m is None:
        return None
    ratio = transmission_ratio(understood.lead_m)
    has_sign = not understood.columns[TORQUE].direction
    try:
        found = (identify_mechanics if has_sign else steady_friction)(frames, ratio)
    except ValueError as error:
        understood.say("inertia_kg_m2", f"cannot be told: {error}")
        return None
    if not found.sign_is_told:
        words = "neither inertia nor friction shows its sign; it is left as recorded"
        understood.say(TORQUE, words, assumed=True)
    if found.is_inverted:
        choice = understood.columns[TORQUE]
        turned = Choice(choice.column, -choice.scale, choice.minus, choice.direction)
        understood.columns[TORQUE] = turned
        understood.say(TORQUE, "sign reversed: as recorded, it counts against the motion")
        for frame in frames:
            frame.channels[TORQUE][:] *= -1.0
    return found


def _travel(frames: Sequence[SampleFrame]) -> float | None:
    values = [f.channels[TABLE_POSITION] for f in frames if TABLE_POSITION in f.channels]
    if not values:
        return None
    return float(max(map(np.nanmax, values)) - min(map(np.nanmin, values)))


def _abilities(
    frames: Sequence[SampleFrame],
    understood: Understanding,
    mechanics: Mechanics | None,
    sheet: DataSheet,
) -> list[Ability]:
    steps = np.concatenate([np.diff(frame.time_s) for frame in frames])
    forward = steps[steps > 0.0]
    rate_hz = 1.0 / float(np.median(forward)) if forward.size else 0.0
    rated = sheet.dynamic_load_rating_n is not None and sheet.preload_n is not None
    return abilities(understood.columns, mechanics, rate_hz, has_rating=rated)


def _draw(frame: SampleFrame, title: str, out: Path) -> None:
    if out.suffix != ".png":
        raise ConfigError(f"--picture {out}: expected a name that ends in .png")
    try:
        write_channels_picture(frame, title, out)
    except OSError as error:
        raise ConfigError(f"--picture {out}: cannot be written ({error.strerror})") from None
