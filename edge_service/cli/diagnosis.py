"""Commands that hold a model against an axis: fingerprint, gap, diagnosis, the thesis' studies."""

import math
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    ABOVE_0,
    AXIS_NUMBER,
    MACHINE,
    OUT_FOLDER,
    PATH,
    TRACES,
    Greedy,
    InputError,
    answering,
    batch_options,
    out_option,
)
from .terminal import progress


@click.command(
    epilog="Example: edge-service fingerprint friction.csv acceleration.csv --out out/now"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@click.option("--baseline", type=PATH, help="Compare with this older fingerprint.json.")
@click.option(
    "--pictures",
    type=PATH,
    help="Also write the pictures as PNG files into this folder.",
)
@OUT_FOLDER
@answering
@batch_options
def fingerprint(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    baseline: Path | None,
    pictures: Path | None,
    out: Path,
) -> Answer:
    """Test an axis from recordings: friction, stiffness, backlash, evenness, modes, preload.

    Several friction tests of one session are also drawn over one another, from first to last. A
    SINUMERIK servo tuning on its own gives modes and inertia and needs no machine file.
    """
    from ..offline.response import is_servo_tuning
    from ..offline.response import response as run_response

    if len(traces) == 1 and is_servo_tuning(traces[0]):
        return run_response(traces[0], out, baseline, name="fingerprint.json")
    from ..offline.fingerprint import fingerprint as run_fingerprint

    return run_fingerprint(machine, traces, out, baseline, pictures, axis_number, progress)


@click.command(epilog="Example: edge-service response AST_AX7.xml --out out/AX7")
@click.argument("source", type=PATH)
@click.option("--baseline", type=PATH, help="Compare with this older response.json.")
@OUT_FOLDER
@answering
def response(source: Path, baseline: Path | None, out: Path) -> Answer:
    """Find modes and inertia in a frequency response measured by a SINUMERIK.

    SOURCE is the XML of an auto servo tuning or of a frequency response measurement. With the modes
    of two masses come inertias, stiffness and damping at the motor. No machine file is needed.
    """
    from ..offline.response import response as run_response

    progress(f"reading {source.name}")
    return run_response(source, out, baseline)


@click.command(epilog="Example: edge-service gap --machine m.toml trace.csv --json")
@TRACES
@MACHINE
@AXIS_NUMBER
@answering
def gap(traces: tuple[Path, ...], machine: Path, axis_number: int | None) -> Answer:
    """Measure the gap between model and machine: torque in motion, and table against motor."""
    from ..offline.diagnosis.gap import gap as measure_gap

    return measure_gap(machine, traces, progress, axis_number)


@click.command(
    cls=Greedy,
    epilog="Example: edge-service diagnose --machine m.toml trace.csv --out out/diagnosis",
)
@TRACES
@MACHINE
@AXIS_NUMBER
@OUT_FOLDER
@click.option(
    "--reference",
    multiple=True,
    metavar="FILE...",
    type=PATH,
    help="Recordings of the healthy machine: what they already show is not taken for a fault.",
)
@answering
@batch_options
def diagnose(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    reference: tuple[Path, ...],
) -> Answer:
    """Find where model and machine disagree, which effect causes it, and how much it explains.

    Ends with status 3 if the recordings cannot be diagnosed; the report says why.
    """
    from ..offline.diagnosis.diagnose import diagnose as run_diagnosis

    return run_diagnosis(machine, traces, out, progress, reference, axis_number)


@click.command(epilog="Example: edge-service drift monday.csv friday.csv --machine m.toml")
@TRACES
@MACHINE
@AXIS_NUMBER
@click.option(
    "--by",
    multiple=True,
    metavar="COLUMN",
    help="Compare only rows with the same value in this column; tool and NC block by default.",
)
@out_option("Folder for drift.json, drift.png and report.html.", required=False)
@answering
def drift(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    by: tuple[str, ...],
    out: Path | None,
) -> Answer:
    """Compare the same moves in recordings of several days, oldest first: what changed, and when.

    Repetitions within a recording show the scatter; moving both ways separates friction and load.
    """
    from ..offline.drift.drift import drift as compare

    return compare(machine, traces, out, axis_number, by, progress).answer(out)


@click.command(epilog="Example: edge-service reproduce --out out/reproduce")
@click.argument("study", type=click.Choice(["thesis", "puzzle", "wear"]), default="thesis")
@click.argument("file", type=PATH, required=False)
@click.option(
    "--out",
    type=PATH,
    default=Path("out/reproduce"),
    show_default=True,
    help="Folder that the report is written to.",
)
@click.option(
    "--stage-h", type=ABOVE_0, default=35.0, show_default=True, help="wear: hours per line."
)
@click.option(
    "--speed-rpm",
    type=ABOVE_0,
    default=300.0,
    show_default=True,
    help="wear: initial speed, r/min.",
)
@click.option(
    "--speed-step-rpm",
    type=click.FloatRange(min=0.0),
    default=200.0,
    show_default=True,
    help="wear: rise of the speed, r/min,",
)
@click.option(
    "--speed-step-h",
    type=ABOVE_0,
    default=140.0,
    show_default=True,
    help="wear: every so many hours.",
)
@answering
def reproduce(
    study: str,
    file: Path | None,
    out: Path,
    stage_h: float,
    speed_rpm: float,
    speed_step_rpm: float,
    speed_step_h: float,
) -> Answer:
    """Repeat the simulations and Table 4.2 of the thesis beside the published figures.

    STUDY puzzle: the diagnosis finds why linear models did not fit the thesis' test bench
    (Figure 5.13).

    STUDY wear FILE: a real screw that wore out, one drag torque a line (N m, the first of the fresh
    screw); what the trend of the service says after every line, beside a straight line.
    """
    if (study == "wear") != (file is not None):
        raise InputError("reproduce: STUDY wear, and no other, needs a FILE of drag torques")
    if file is not None:
        from ..offline.wear.reproduce import reproduce_wear
        from ..offline.wear.stages import Schedule

        figures = stage_h, speed_rpm, speed_step_rpm, speed_step_h
        if not all(map(math.isfinite, figures)):
            raise InputError("reproduce: hours and speeds must be finite numbers")
        schedule = Schedule(*figures)
        progress(f"dates after every line of {file.name}")
        return reproduce_wear(file, schedule, out)
    if study == "puzzle":
        from ..offline.thesis.puzzle import reproduce_puzzle

        return reproduce_puzzle(out, progress)
    from ..offline.thesis.reproduce import reproduce as run_study

    found = run_study(out, progress=progress)
    return Answer(f"{found.as_text()}\nreport: {out / 'report.html'}", found)
