"""Commands that examine an axis: its health, its mechanics, and its gap to the model."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import click

from ..command_answer import Answer
from ..exit_status import BadInputError
from .options import (
    POSITIVE,
    AxisNumber,
    Batch,
    Effects,
    Greedy,
    MachineFile,
    Option,
    OutFolder,
    Seed,
    Traces,
    Without,
    batch_options,
    command,
)

By = Annotated[
    tuple[str, ...],
    Option(
        "Compare only moves with the same value in this column; tool and NC block by default.",
        metavar="COLUMN",
    ),
]


@command("commission --machine m.toml healthy.csv --out commissioned.toml")
def commission(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: Annotated[Path, Option("Machine file to write.")],
    tests: Annotated[
        tuple[Path, ...], Option("Recording of `motion chirp`; repeat for other days.", "--test")
    ],
    assume_fresh: Annotated[
        bool, Option("Treat the screw as fresh although recordings or data sheet say otherwise.")
    ],
    interval: Annotated[
        float | None,
        Option(
            "Length of the blocks that the estimator takes, s; kept in the machine file.  "
            "[default: the machine file's, or 0.1]",
            kind=click.FloatRange(0.001, 10.0),
        ),
    ],
) -> Answer:
    """Learn what is normal from a healthy, cold axis."""
    from ..offline.commission import commission_to_file as run

    return run(machine, traces, out, axis_number, tests, interval, assume_fresh=assume_fresh)


@command("estimate --machine m.toml trace.csv --out estimates.csv")
@batch_options("estimates.csv", implied=True)
def estimate(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: Annotated[Path, Option("CSV file, one row per block; a folder for several TRACEs.")],
    state: Annotated[
        Path | None,
        Option("Continue from the state in this file if it exists; write the new state to it."),
    ],
    batch: Batch | None,
    method: Annotated[Literal["auto", "kf-imm", "sif-imm", "mixture"], Option("Method.")] = "auto",
) -> Answer:
    """Run the live estimator over recordings.

    Several TRACEs are cases of their own, and --out is a folder.
    """
    from ..config import EstimatorConfig
    from ..offline.estimate import estimate_case, estimate_to_csv

    config = EstimatorConfig(method=method)
    if batch is None:
        return estimate_to_csv(traces[0], machine, out, config, state, axis_number)
    if state is not None:
        raise BadInputError("--state: goes with one recording, not with several")
    work = partial(estimate_case, machine, config=config, axis_number=axis_number)
    return batch(work, traces, out)


@command("fingerprint friction.csv acceleration.csv --out out/now")
@batch_options("fingerprint.json", "report.html", "drift.json")
def fingerprint(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: OutFolder,
    baseline: Annotated[Path | None, Option("Compare with this older fingerprint.json.")],
    by: By,
    batch: Batch | None,
) -> Answer:
    """Test the mechanics of an axis, and show what has changed.

    Friction, stiffness, backlash, evenness, modes, preload. Moves that several recordings repeat
    are compared, oldest first: what changed, and when. A servo tuning or frequency response of a
    SINUMERIK gives modes and inertia; on its own it needs no machine file.
    """
    from ..offline.fingerprint import fingerprint as run

    written = out / "fingerprint.json" if batch is None else out
    if baseline is not None and baseline.resolve().is_relative_to(written.resolve()):
        raise BadInputError(f"--out {out}: would overwrite the baseline; choose another folder")
    work = partial(run, machine, baseline_file=baseline, axis_number=axis_number, by=by)
    return batch(work, traces, out) if batch else work(traces, out)


@command("drift monday.csv friday.csv --machine m.toml", hidden=True)
def drift(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    by: By,
    out: Annotated[Path | None, Option("Folder for drift.json.")],
) -> Answer:
    """Compare the same moves in recordings of several days, as fingerprint does."""
    from ..offline.drift import drift as compare

    return compare(machine, traces, out, axis_number, by)


@command("motion next out/diagnosis.json --out setpoints.csv")
def motion(
    name: str | None,
    file: str | None,
    machine: MachineFile,
    duration: Annotated[float | None, Option("Length of the whole motion, s.", kind=POSITIVE)],
    clip: Annotated[bool, Option("Leave out, and list, what is beyond the axis' limits.")],
    effects: Effects,
    out: Annotated[Path | None, Option("Setpoints as .csv, an NC program as .mpf.")],
    rate: Annotated[float, Option("Setpoints written per second.", kind=POSITIVE)] = 1000.0,
    seed: Seed = 1,
) -> Answer:
    """Write a test motion for the controller, or choose the next.

    Without NAME all are listed. `motion next DIAGNOSIS.json`, or `next` with --effect twice or
    more, proposes the shortest motion that separates the causes between which a diagnosis could not
    decide. `motion isolability NAME|TRACE` shows what a motion can distinguish, before anything is
    measured. A motion beyond stroke, speed, acceleration or torque of the machine file is refused.
    """
    from ..config import load_machine
    from ..offline import motion as motions

    axis = load_machine(machine)
    if name is None:
        if out is not None:
            raise BadInputError("motion: --out goes with the NAME of a motion")
        return motions.list_motions(axis)
    settings = motions.MotionFileSettings(duration, rate, seed or 0, clip)
    if name == "next":
        if (file is not None) + bool(effects) != 1:
            raise BadInputError("motion next: expected a DIAGNOSIS.json, or --effect twice or more")
        tied = motions.tied_effects(Path(file)) if file else {each: {} for each in effects}
        return motions.next_motion(axis, tied, out, settings)
    if name == "isolability":
        if file is None:
            raise BadInputError("motion isolability: expected the NAME of a motion, or a TRACE")
        return motions.isolability(axis, file)
    if file is not None or effects:
        raise BadInputError(f"motion: {name} takes no file and no --effect")
    if out is None:
        raise BadInputError(f"motion: {name}: expected --out FILE")
    return motions.write_motion(name, axis, out, settings)


@command("gap --machine m.toml trace.csv --json")
def gap(traces: Traces, machine: MachineFile, axis_number: AxisNumber) -> Answer:
    """Measure how far the model is from the machine.

    Torque in motion, and table against motor.
    """
    from ..offline.diagnosis.gap import gap as measure

    return measure(machine, traces, axis_number)


@command("diagnose --machine m.toml trace.csv --out out/diagnosis", cls=Greedy)
@batch_options("diagnosis.json", "augmented.toml", "report.html")
def diagnose(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: OutFolder,
    reference: Annotated[
        tuple[Path, ...],
        Option(
            "Recordings of the healthy machine: what they already show is not taken for a fault.",
            metavar="FILE...",
        ),
    ],
    without: Without,
    batch: Batch | None,
) -> Answer:
    """Find why they differ, and how much each cause explains.

    Ends with status 3 if the recordings cannot be diagnosed; the report says why.
    """
    from ..offline.diagnosis.diagnose import diagnose as run

    work = partial(run, machine, reference=reference, axis_number=axis_number, without=without)
    return batch(work, traces, out) if batch else work(traces, out)


@command("update --machine commissioned.toml later.csv")
def update(
    traces: Traces,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: Annotated[Path | None, Option("Machine file to write.  [default: NAME-DATE.toml]")],
) -> Answer:
    """Bring the model up to date; a lost preload is never learned.

    Written if the gap shrinks on held-out blocks; status 1 if a fault may be among the causes.
    """
    from ..offline.update import update as run

    return run(machine, traces, out, axis_number)
