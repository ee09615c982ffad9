"""Commands about the twin: simulations, the thesis' studies, benchmarks."""

import pkgutil
import sys
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import click

from ..command_answer import Answer
from ..exit_status import BadInputError
from .options import POSITIVE, Effects, Keys, MachineFile, Option, Screw, Seed, command
from .terminal import progress


@command("simulate --motion friction --effect stribeck:excess_nm=0.2 --seed 7 --out trace.csv")
def simulate(
    machine: MachineFile,
    effects: Effects,
    duration: Annotated[float | None, Option("Length, s; by default the motion's.", kind=POSITIVE)],
    preload: Annotated[
        float | None,
        Option(
            "Preload in percent of the load rating; that of the fresh screw by default.",
            kind=click.FloatRange(0.0, 100.0),
        ),
    ],
    out: Annotated[Path, Option("File to write, .csv or .parquet; a folder for several motions.")],
    motions: Annotated[
        tuple[str, ...],
        Option(
            "Motion to run; may be repeated, one after another.",
            "--motion",
            metavar="NAME[:duration_s=SECONDS]",
        ),
    ] = ("production",),
    seed: Seed = 1,
) -> Answer:
    """Record a simulated axis with any set of effects.

    Beside the effects of the library there are payload:mass_kg=20, which the drive does not know
    of, and forces that are recorded: milling:force_n=-500, drilling and external_force:file=f.csv.
    """
    from ..config import load_machine
    from ..offline import simulate as room

    settings = room.SimulationSettings(motions[0], effects, duration, preload, seed or 0)
    if len(motions) == 1:
        return room.simulate(load_machine(machine), settings, out)
    if duration is not None:
        raise BadInputError("--duration: with several motions expected NAME:duration_s=SECONDS")
    return room.simulate_session(load_machine(machine), settings, motions, out)


@command('model --screw "20x20 C7450 P510" --export model.mat')
def model(
    machine: MachineFile,
    screw: Screw,
    keys: Keys,
    export: Annotated[Path | None, Option("File for other programs, .mat, .npz or .csv.")],
    plot: Annotated[Path | None, Option("PNG file for responses and stiffnesses.")],
    efficiency: Annotated[
        float, Option("Efficiency of the screw (4.3.6).", kind=click.FloatRange(0.1, 1.0))
    ] = 0.9,
    rate: Annotated[float, Option("Rate of the sampled models, Hz.", kind=POSITIVE)] = 1000.0,
) -> Answer:
    """Compute drag, stiffness, inertia and dynamics of a drive.

    What --screw and --set state takes precedence over the machine file; drag and inertia follow.
    """
    from ..config import load_machine
    from ..offline import model as room
    from ..offline.machine_text import stated

    given = room.machine_of(load_machine(machine), stated(screw, None, keys), efficiency)
    return room.model(given, rate, efficiency, export, plot)


@command("reproduce --out out/reproduce")
def reproduce(
    study: Literal["thesis", "puzzle", "wear"] = "thesis",
    file: Path | None = None,
    seed: Seed = None,
    out: Annotated[Path, Option("Folder for the report.")] = Path("out/reproduce"),
    window: Annotated[
        int,
        Option("thesis: moving average over so many steps of 0.1 s.", kind=click.IntRange(1, 500)),
    ] = 20,
    exponent: Annotated[
        float,
        Option("thesis: exponent of the weighted sum (4.5.4).", kind=click.FloatRange(1.0, 8.0)),
    ] = 1.33,
) -> Answer:
    """Repeat the thesis' simulations beside published results.

    STUDY puzzle: the diagnosis finds why linear models did not fit the thesis' test bench
    (Figure 5.13).

    STUDY wear FILE: a real screw that wore out; what the trend of the service says after every
    reading. FILE has columns time_h, speed_rpm, drag_torque_nm, or one drag torque a line (N m).
    """
    if (study == "wear") != (file is not None):
        raise BadInputError("reproduce: STUDY wear, and no other, needs a FILE of drag torques")
    if file is not None:
        from ..offline.reproduce.wear import reproduce_wear

        progress(f"dates after every reading of {file.name}")
        return reproduce_wear(file, out)
    if study == "puzzle":
        from ..offline.reproduce import puzzle

        return puzzle.reproduce_puzzle(out, puzzle.SEED if seed is None else seed)
    from ..offline.reproduce import thesis

    found = thesis.reproduce(out, seed=seed or 0, window_steps=window, exponent=exponent)
    return Answer(f"{found.as_text()}\nreport: {out / 'report.html'}", found)


@click.command(
    context_settings={"ignore_unknown_options": True},
    add_help_option=False,
    epilog="Example: edge-service bench estimator --quick --only life",
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def bench(arguments: tuple[str, ...]) -> object:
    """Measure speed, memory and accuracy."""
    return benchmarks(Path(__file__).parents[2]).main(
        list(arguments), prog_name="edge-service bench", standalone_mode=False
    )


def benchmarks(checkout: Path) -> click.Command:
    """Command that the project file of a checkout names; `BadInputError` where it names none."""
    try:
        project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))
        named = str(project["tool"]["edge-service"]["benchmarks"])
    except (OSError, KeyError):
        none = "it needs a checkout of the project, and this is an installed package"
        raise BadInputError(f"bench: {none}") from None
    if str(checkout) not in sys.path:
        sys.path.insert(0, str(checkout))
    found = pkgutil.resolve_name(named)
    assert isinstance(found, click.Command)
    return found
