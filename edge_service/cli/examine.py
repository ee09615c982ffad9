"""Commands that examine an axis: its health, its mechanics, and its gap to the model."""

from functools import partial
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    EFFECTS,
    MACHINE,
    OUT_FOLDER,
    PATH,
    POSITIVE,
    SEED,
    TRACES,
    Batch,
    Greedy,
    InputError,
    answering,
    batch_options,
    out_option,
)
from .terminal import progress

BY = click.option(
    "--by",
    multiple=True,
    metavar="COLUMN",
    help="Compare only moves with the same value in this column; tool and NC block by default.",
)


@click.command(
    epilog="Example: edge-service commission --machine m.toml healthy.csv --out commissioned.toml"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@out_option("Machine file to write.")
@click.option(
    "--assume-fresh",
    is_flag=True,
    help="Treat the screw as fresh although recordings or data sheet say otherwise.",
)
@click.option(
    "--interval",
    "interval_s",
    type=click.FloatRange(0.001, 10.0),
    show_default="the machine file's, or 0.1",
    help="Length of the blocks that the estimator takes, s; kept in the machine file.",
)
@answering
def commission(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    assume_fresh: bool,
    interval_s: float | None,
) -> Answer:
    """Learn what is normal from a healthy, cold axis."""
    from ..offline.commission import commission_to_file

    return commission_to_file(
        machine,
        traces,
        out,
        axis_number,
        assume_fresh=assume_fresh,
        interval_s=interval_s,
        progress=progress,
    )


@click.command(
    epilog="Example: edge-service estimate --machine m.toml trace.csv --out estimates.csv"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@out_option("CSV file to write, one row per block; a folder for several TRACEs.")
@click.option(
    "--method",
    metavar="auto|kf-imm|sif-imm|mixture",
    default="auto",
    show_default=True,
    help="Estimator.",
)
@click.option(
    "--state",
    type=PATH,
    help="Continue from the state in this file if it exists; write the new state to it.",
)
@answering
@batch_options("estimates.csv", implied=True)
def estimate(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    method: str,
    state: Path | None,
    batch: Batch | None,
) -> Answer:
    """Run the live estimator over recordings.

    Several TRACEs are cases of their own, and --out is a folder.
    """
    from ..config import EstimatorConfig
    from ..estimate.registry import AUTO, ESTIMATORS
    from ..offline.estimate import estimate_case, estimate_to_csv

    if method not in (AUTO, *ESTIMATORS):
        there = ", ".join((AUTO, *ESTIMATORS))
        raise InputError(f"--method: no estimator {method!r}; there are {there}")
    config = EstimatorConfig(method=method)
    if batch is not None:
        if state is not None:
            raise InputError("--state: goes with one recording, not with several")
        work = partial(estimate_case, machine, config=config, axis_number=axis_number)
        return batch(work, traces, out)
    return estimate_to_csv(traces[0], machine, out, config, state, axis_number, progress)


@click.command(
    epilog="Example: edge-service fingerprint friction.csv acceleration.csv --out out/now"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@OUT_FOLDER
@click.option("--baseline", type=PATH, help="Compare with this older fingerprint.json.")
@BY
@answering
@batch_options("fingerprint.json", "report.html", "drift.json")
def fingerprint(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    baseline: Path | None,
    by: tuple[str, ...],
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


@click.command(
    hidden=True, epilog="Example: edge-service drift monday.csv friday.csv --machine m.toml"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@BY
@out_option("Folder for drift.json.", required=False)
@answering
def drift(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    by: tuple[str, ...],
    out: Path | None,
) -> Answer:
    """Compare the same moves in recordings of several days, as fingerprint does."""
    from ..offline.drift import drift as compare

    return compare(machine, traces, out, axis_number, by, progress)


@click.command(epilog="Example: edge-service motion next out/diagnosis.json --out setpoints.csv")
@click.argument("name", required=False)
@click.argument("file", required=False)
@MACHINE
@click.option("--duration", "duration_s", type=POSITIVE, help="Length of the whole motion, s.")
@click.option(
    "--rate",
    "rate_hz",
    type=POSITIVE,
    default=1000.0,
    show_default=True,
    help="Setpoints written per second.",
)
@SEED
@click.option("--clip", is_flag=True, help="Leave out, and list, what is beyond the axis' limits.")
@EFFECTS
@out_option("Setpoints as .csv, an NC program as .mpf; a .png of the list.", required=False)
@answering
def motion(
    name: str | None,
    file: str | None,
    machine: Path,
    duration_s: float | None,
    rate_hz: float,
    seed: int | None,
    clip: bool,
    effects: tuple[str, ...],
    out: Path | None,
) -> Answer:
    """Write a test motion for the controller, or choose the next.

    Without NAME all are listed. `motion next DIAGNOSIS.json`, or `next` with --effect twice or
    more, proposes the shortest motion that separates the causes between which a diagnosis could not
    decide. `motion isolability NAME|TRACE` shows what a motion can distinguish, before anything is
    measured. A motion beyond stroke, speed, acceleration or torque of the machine file is refused.
    """
    from ..config import load_machine
    from ..offline import motion_file, next_motion

    axis = load_machine(machine)
    if name is None:
        return motion_file.list_motions(axis, out)
    settings = motion_file.MotionFileSettings(
        duration_s, rate_hz, 1 if seed is None else seed, clip
    )
    if name == "next":
        if (file is not None) + bool(effects) != 1:
            raise InputError("motion next: expected one DIAGNOSIS.json, or --effect twice or more")
        tied = next_motion.tied_effects(Path(file)) if file else {each: {} for each in effects}
        return next_motion.next_motion(axis, tied, out, settings, progress)
    if name == "isolability":
        if file is None:
            raise InputError("motion isolability: expected the NAME of a motion, or a TRACE")
        return next_motion.isolability(axis, file, progress)
    if file is not None:
        raise InputError(f"motion: {file}: {name} takes no file")
    if out is None:
        raise InputError(f"motion: {name}: expected --out FILE")
    written = motion_file.write_motion(name, axis, out, settings, progress)
    return Answer(written.as_text(), written)


@click.command(epilog="Example: edge-service gap --machine m.toml trace.csv --json")
@TRACES
@MACHINE
@AXIS_NUMBER
@answering
def gap(traces: tuple[Path, ...], machine: Path, axis_number: int | None) -> Answer:
    """Measure how far the model is from the machine.

    Torque in motion, and table against motor.
    """
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
    """Find why they differ, and how much each cause explains.

    Ends with status 3 if the recordings cannot be diagnosed; the report says why.
    """
    from ..offline.diagnosis.diagnose import diagnose as run_diagnosis

    if batch is not None:
        work = partial(run_diagnosis, machine, reference=reference, axis_number=axis_number)
        return batch(work, traces, out)
    return run_diagnosis(machine, traces, out, progress, reference, axis_number)
