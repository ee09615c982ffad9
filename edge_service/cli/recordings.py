"""Commands that make a trace: of a running service, a foreign file or the simulated axis."""

import asyncio
from dataclasses import dataclass
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    BUS,
    CONFIG,
    MACHINE,
    PATH,
    InputError,
    answering,
    configured,
    out_option,
)
from .terminal import progress


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording of a running service."""

    out: str
    axis: str
    rows: int
    lost_payloads: int


@click.command(epilog="Example: edge-service record --axis X --duration 60 --out trace.csv")
@CONFIG
@click.option("--axis", help="Axis to record; the first configured one by default.")
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0.0, min_open=True),
    help="How long to record, s; until Ctrl-C by default.",
)
@out_option("File to write, .csv or .parquet.")
@BUS
@answering
def record(
    config: Path | None, axis: str | None, duration_s: float | None, out: Path, endpoint: str | None
) -> Answer:
    """Write what a running service publishes to a trace file, until --duration or Ctrl-C."""
    from ..nodes.record_node import record_axis

    settings = configured(config, None, endpoint)
    name = axis or settings.axes[0].name
    progress(f"recording axis {name}")

    def tell(share: float) -> None:
        progress(f"edge-service record: recording axis {name}, {100.0 * share:.0f} %")

    rows, lost = asyncio.run(record_axis(settings, name, out, duration_s, tell))
    words = f"{out}: {rows} rows of axis {name}, {lost} payloads lost"
    return Answer(words, Recorded(out=str(out), axis=name, rows=rows, lost_payloads=lost))


@click.command(epilog="Example: edge-service convert trace.xml --axis-number 7 --out trace.parquet")
@click.argument("source", type=PATH)
@MACHINE
@out_option("File to write; its name ends in .csv, .parquet or .mcap.")
@AXIS_NUMBER
@click.option(
    "--torque-constant",
    "torque_constant_nm_per_a",
    type=click.FloatRange(0.0, min_open=True),
    help="Torque constant, N m per A: turns a current into torque where no torque was recorded.",
)
@click.option(
    "--interpolate",
    is_flag=True,
    help="Interpolate positions that were sampled more slowly, instead of holding them.",
)
@click.option(
    "--all",
    "keep_all",
    is_flag=True,
    help="Also keep columns that are not channels, under their own names.",
)
@answering
def convert(
    source: Path,
    machine: Path,
    out: Path,
    axis_number: int | None,
    torque_constant_nm_per_a: float | None,
    interpolate: bool,
    keep_all: bool,
) -> Answer:
    """Convert a recording or the kept history to another format: CSV, Parquet or MCAP.

    SOURCE is text (CSV), Parquet, the XML of a SINUMERIK trace, a recording of Industrial Edge or a
    MATLAB 5 file; SINUMERIK and Industrial Edge names are known. The machine file gives the lead
    and, under [columns], names that take precedence. Of edge-service.sqlite the history of all axes
    is written, with a column `axis`.
    """
    from ..config import load_machine
    from ..offline.convert import convert as convert_trace
    from ..offline.convert import convert_history, is_database
    from ..offline.recordings import controller_axis

    if is_database(source):
        return convert_history(source, out, progress)

    model = load_machine(machine)
    axis = controller_axis(
        model, axis_number, torque_constant_nm_per_a, interpolate_positions=interpolate
    )
    summary = convert_trace(source, out, model, axis, keep_all=keep_all, progress=progress)
    return Answer(summary.as_text(), summary)


@click.command(
    epilog="Example: edge-service simulate --motion friction --effect stribeck:excess_nm=0.2 "
    "--seed 7 --out trace.csv"
)
@MACHINE
@click.option(
    "--motion",
    "motions",
    multiple=True,
    default=("production",),
    show_default="production",
    help="Motion to run, NAME[:duration_s=SECONDS]; repeat it for several, one after another.",
)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    help="Effect to add, NAME[:key=value,...]; repeat it for several.",
)
@click.option(
    "--duration",
    "duration_s",
    type=float,
    help="Length of the recording, s; that of the motion by default.",
)
@click.option(
    "--preload",
    "preload_percent",
    type=float,
    help="Preload in percent of the load rating; that of the fresh screw by default.",
)
@click.option("--added-mass", "added_mass_kg", default=0.0, help="Mass added to the table, kg.")
@click.option(
    "--external-force", "external_force_n", default=0.0, help="Constant force on the table, N."
)
@click.option(
    "--seed",
    default=1,
    show_default=True,
    type=click.IntRange(min=0),
    help="Seed of noise and random moves.",
)
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["csv", "parquet"]),
    help="Format of the files in a folder; csv by default.",
)
@out_option("File to write, .csv or .parquet; a folder for 01_NAME.csv, ... with several motions.")
@answering
def simulate(
    machine: Path,
    motions: tuple[str, ...],
    effects: tuple[str, ...],
    duration_s: float | None,
    preload_percent: float | None,
    added_mass_kg: float,
    external_force_n: float,
    seed: int,
    file_format: str | None,
    out: Path,
) -> Answer:
    """Record the simulated axis with any set of effects."""
    from ..config import load_machine
    from ..offline.simulate import SimulationSettings, simulate_session
    from ..offline.simulate import simulate as run_simulation
    from ..recordings.writer import TraceFormat

    settings = SimulationSettings(
        motions[0], effects, duration_s, preload_percent, added_mass_kg, external_force_n, seed
    )
    if len(motions) == 1:
        if file_format is not None:
            raise InputError("--format: with one motion the name of --out says it")
        return run_simulation(load_machine(machine), settings, out, progress)
    if duration_s is not None:
        raise InputError("--duration: with several motions expected NAME:duration_s=SECONDS")
    files = TraceFormat(file_format or "csv")
    return simulate_session(load_machine(machine), settings, motions, out, files, progress)
