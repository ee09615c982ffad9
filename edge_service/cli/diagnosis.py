"""Commands that hold a model against an axis: fingerprint, gap, diagnosis, the thesis' studies."""

from functools import partial
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    MACHINE,
    OUT_FOLDER,
    PATH,
    TRACES,
    Batch,
    Greedy,
    InputError,
    answering,
    batch_options,
    out_option,
)
from .terminal import progress

_BY = click.option(
    "--by",
    multiple=True,
    metavar="COLUMN",
    help="Compare only moves with the same value in this column; tool and NC block by default.",
)


@click.command(
    epilog="Example: edge-service fingerprint friction.csv acceleration.csv --out out/now"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@click.option("--baseline", type=PATH, help="Compare with this older fingerprint.json.")
@_BY
@OUT_FOLDER
@answering
@batch_options("fingerprint.json", "report.html", "drift.json")
def fingerprint(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    baseline: Path | None,
    by: tuple[str, ...],
    out: Path,
    batch: Batch | None,
) -> Answer:
    """Test the mechanics of an axis, and show what has changed.

    Friction, stiffness, backlash, evenness, modes, preload. Moves that several recordings repeat
    are compared, oldest first: what changed, and when. A servo tuning or frequency response of a
    SINUMERIK gives modes and inertia; on its own it needs no machine file.
    """
    from ..offline.fingerprint import fingerprint as run_fingerprint

    if batch is not None:
        work = partial(
            run_fingerprint, machine, baseline_file=baseline, axis_number=axis_number, by=by
        )
        return batch(work, traces, out)
    return run_fingerprint(machine, traces, out, baseline, axis_number, by, progress)


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
@batch_options("diagnosis.json", "augmented.toml", "report.html")
def diagnose(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    reference: tuple[Path, ...],
    batch: Batch | None,
) -> Answer:
    """Find where model and machine disagree, which effect causes it, and how much it explains.

    Ends with status 3 if the recordings cannot be diagnosed; the report says why.
    """
    from ..offline.diagnosis.diagnose import diagnose as run_diagnosis

    if batch is not None:
        work = partial(run_diagnosis, machine, reference=reference, axis_number=axis_number)
        return batch(work, traces, out)
    return run_diagnosis(machine, traces, out, progress, reference, axis_number)


@click.command(
    hidden=True, epilog="Example: edge-service drift monday.csv friday.csv --machine m.toml"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@_BY
@out_option("Folder for drift.json.", required=False)
@answering
def drift(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    by: tuple[str, ...],
    out: Path | None,
) -> Answer:
    """Compare the same moves in recordings of several days, oldest first, as fingerprint does."""
    from ..offline.drift import drift as compare

    return compare(machine, traces, out, axis_number, by, progress)


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
    "--seed", type=click.IntRange(0), show_default="0, puzzle: 1", help="Seed of the noise."
)
@click.option(
    "--window",
    type=click.IntRange(1, 500),
    default=20,
    show_default=True,
    help="thesis: moving average in the figures, steps of 0.1 s.",
)
@click.option(
    "--exponent",
    type=click.FloatRange(1.0, 8.0),
    default=1.33,
    show_default=True,
    help="thesis: exponent of the weighted sum (4.5.4).",
)
@answering
def reproduce(
    study: str, file: Path | None, out: Path, seed: int | None, window: int, exponent: float
) -> Answer:
    """Repeat the thesis' simulations beside published results.

    STUDY puzzle: the diagnosis finds why linear models did not fit the thesis' test bench
    (Figure 5.13).

    STUDY wear FILE: a real screw that wore out; what the trend of the service says after every
    reading. FILE has columns time_h, speed_rpm, drag_torque_nm, or one drag torque a line (N m).
    """
    if (study == "wear") != (file is not None):
        raise InputError("reproduce: STUDY wear, and no other, needs a FILE of drag torques")
    if file is not None:
        from ..offline.reproduce.wear import reproduce_wear

        progress(f"dates after every reading of {file.name}")
        return reproduce_wear(file, out)
    if study == "puzzle":
        from ..offline.reproduce import puzzle

        return puzzle.reproduce_puzzle(out, puzzle.SEED if seed is None else seed, progress)
    from ..offline.reproduce import thesis

    found = thesis.reproduce(
        out, seed=seed or 0, window_steps=window, exponent=exponent, progress=progress
    )
    return Answer(f"{found.as_text()}\nreport: {out / 'report.html'}", found)
