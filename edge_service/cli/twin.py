"""Commands about the twin: simulations, the thesis' studies, benchmarks."""

import pkgutil
import sys
import tomllib
from pathlib import Path

import click

from ..command_answer import Answer
from .options import EFFECTS, MACHINE, PATH, POSITIVE, SEED, InputError, answering, out_option
from .terminal import progress

CHECKOUT = Path(__file__).parents[2]


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
    metavar="NAME[:duration_s=SECONDS]",
    help="Motion to run; may be repeated, one after another.",
)
@EFFECTS
@click.option(
    "--duration",
    "duration_s",
    type=POSITIVE,
    help="Length of the recording, s; that of the motion by default.",
)
@click.option(
    "--preload",
    "preload_percent",
    type=click.FloatRange(0.0, 100.0),
    help="Preload in percent of the load rating; that of the fresh screw by default.",
)
@SEED
@out_option("File to write, .csv or .parquet; a folder for several motions.")
@answering
def simulate(
    machine: Path,
    motions: tuple[str, ...],
    effects: tuple[str, ...],
    duration_s: float | None,
    preload_percent: float | None,
    seed: int | None,
    out: Path,
) -> Answer:
    """Record a simulated axis with any set of effects.

    Beside the effects of the library there are payload:mass_kg=20, which the drive does not know
    of, and external_force:file=f.csv (time_s, force_n), which is recorded as measured.
    """
    from ..config import load_machine
    from ..offline.simulate import SimulationSettings, simulate_session
    from ..offline.simulate import simulate as run_simulation

    settings = SimulationSettings(
        motions[0], effects, duration_s, preload_percent, 1 if seed is None else seed
    )
    if len(motions) == 1:
        return run_simulation(load_machine(machine), settings, out, progress)
    if duration_s is not None:
        raise InputError("--duration: with several motions expected NAME:duration_s=SECONDS")
    return simulate_session(load_machine(machine), settings, motions, out, progress=progress)


@click.command(epilog="Example: edge-service reproduce --out out/reproduce")
@click.argument(
    "study", type=click.Choice(["thesis", "puzzle", "wear"]), default="thesis", metavar="[STUDY]"
)
@click.argument("file", type=PATH, required=False)
@click.option(
    "--out",
    type=PATH,
    default=Path("out/reproduce"),
    show_default=True,
    help="Folder for the report.",
)
@SEED
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


@click.command(
    context_settings={"ignore_unknown_options": True},
    add_help_option=False,
    epilog="Example: edge-service bench estimator --quick --only life",
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def bench(arguments: tuple[str, ...]) -> object:
    """Measure speed, memory and accuracy."""
    return benchmarks(CHECKOUT).main(
        list(arguments), prog_name="edge-service bench", standalone_mode=False
    )


def benchmarks(checkout: Path) -> click.Command:
    """Command that the project file of a checkout names; `InputError` where it names none."""
    try:
        project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))
        named = str(project["tool"]["edge-service"]["benchmarks"])
    except (OSError, KeyError):
        none = "it needs a checkout of the project, and this is an installed package"
        raise InputError(f"bench: {none}") from None
    if str(checkout) not in sys.path:
        sys.path.insert(0, str(checkout))
    found = pkgutil.resolve_name(named)
    assert isinstance(found, click.Command)
    return found
