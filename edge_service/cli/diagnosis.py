"""Commands that hold a model against an axis: fingerprint, gap, diagnosis, the thesis' studies."""

import json
from pathlib import Path

import click

from .options import AXIS_NUMBER, MACHINE, OUT_FOLDER, PATH, TRACES, Greedy, json_option
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
def fingerprint(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    baseline: Path | None,
    pictures: Path | None,
    out: Path,
) -> None:
    """Test an axis from recordings: friction, stiffness, backlash, evenness, modes, preload.

    Several friction tests of one session are also drawn over one another, from first to last.
    """
    from ..offline.fingerprint import fingerprint as run_fingerprint

    click.echo(run_fingerprint(machine, traces, out, baseline, pictures, axis_number))


@click.command(epilog="Example: edge-service response AST_AX7.xml --out out/AX7")
@click.argument("source", type=PATH)
@click.option("--baseline", type=PATH, help="Compare with this older response.json.")
@json_option("Print the content of response.json instead of the summary.")
@OUT_FOLDER
def response(source: Path, baseline: Path | None, as_json: bool, out: Path) -> None:
    """Find modes and inertia in a frequency response that a SINUMERIK has measured.

    SOURCE is the XML of an auto servo tuning or of a frequency response measurement. With the modes
    of two masses come inertias, stiffness and damping at the motor; none needs a machine file.
    """
    from ..offline.response import response as run_response

    click.echo(run_response(source, out, baseline, as_json=as_json))


@click.command(epilog="Example: edge-service gap --machine m.toml trace.csv --json")
@TRACES
@MACHINE
@AXIS_NUMBER
@json_option("Print one JSON object: channel -> RMS of the gap.")
def gap(traces: tuple[Path, ...], machine: Path, axis_number: int | None, as_json: bool) -> None:
    """Measure the gap between model and machine: torque in motion, and table against motor."""
    from ..offline.diagnosis.gap import gap as measure_gap

    found = measure_gap(machine, traces, progress, axis_number)
    if as_json:
        click.echo(json.dumps(found))
    else:
        for name, rms in found.items():
            click.echo(f"{name}: {rms:.4g}")


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
    help="Recordings of the healthy machine: what they have beyond the model is no fault.",
)
def diagnose(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    reference: tuple[Path, ...],
) -> None:
    """Say where model and machine disagree, which effect causes it, and how far it shrinks.

    Ends with status 3 where the recordings are unfit for it; the report says why.
    """
    from ..offline.diagnosis.diagnose import diagnose as run_diagnosis

    click.echo(run_diagnosis(machine, traces, out, progress, reference, axis_number))


@click.command(epilog="Example: edge-service reproduce --out out/reproduce")
@click.argument("study", type=click.Choice(["thesis", "puzzle"]), default="thesis")
@click.option(
    "--out",
    type=PATH,
    default=Path("out/reproduce"),
    show_default=True,
    help="Folder that the report is written to.",
)
def reproduce(study: str, out: Path) -> None:
    """Repeat the simulations and Table 4.2 of the thesis beside the published figures.

    STUDY puzzle: the diagnosis finds why linear models did not fit the thesis' test bench
    (Figure 5.13).
    """
    if study == "puzzle":
        from ..offline.thesis.puzzle import reproduce_puzzle

        click.echo(reproduce_puzzle(out, progress))
        return
    from ..offline.thesis.reproduce import reproduce as run_study

    click.echo(run_study(out, progress=progress).as_text())
    click.echo(f"report: {out / 'report.html'}")
