"""Commands that measure: speed and size, and how right the answers are."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from edge_service.cli.options import FLAG, PATH, InputError
from edge_service.cli.terminal import progress

from .estimator.parts import FIRST_SEED, PARTS, PROCESSES
from .speed.parts_of import SPEED_PARTS
from .table import PipelineBench

if TYPE_CHECKING:
    from .identification.bench import IdentificationBench


JSON = click.option(FLAG, "as_json", is_flag=True, help="Print the figures as JSON.")
QUICK = click.option("--quick", is_flag=True, help="Measure for a shorter time.")


@click.group(invoke_without_command=True, epilog="Example: edge-service bench identification")
@QUICK
@JSON
@click.pass_context
def bench(context: click.Context, quick: bool, as_json: bool) -> None:
    """Measure speed and size: start, CPU, memory, delay, replay, estimator steps.

    The sub-commands measure how right the answers are.
    """
    if context.invoked_subcommand is not None:
        if quick or as_json:
            raise InputError(f"bench: options of {context.invoked_subcommand} come after its name")
        return
    from .pipeline.bench import PipelineBenchSettings, run_pipeline_bench

    _print_report(run_pipeline_bench(PipelineBenchSettings(quick=quick), progress), as_json)


def _print_report(report: "PipelineBench | IdentificationBench", as_json: bool) -> None:
    click.echo(json.dumps(report.as_dict(), indent=2) if as_json else report.as_text())


@bench.command("identification", epilog="Example: edge-service bench identification --seeds 10")
@click.option(
    "--seeds",
    type=click.IntRange(1),
    default=100,
    show_default=True,
    help="Number of simulated axes.",
)
@JSON
def bench_identification(seeds: int, as_json: bool) -> None:
    """Hold identified parameters against the truth."""
    from .identification.bench import run

    _print_report(run(seeds, progress), as_json)


@bench.command("estimator", epilog="Example: edge-service bench estimator --quick --only life")
@click.option("--quick", is_flag=True, help="Run fewer axes for a shorter time.")
@click.option(
    "--only",
    type=click.Choice(PARTS),
    multiple=True,
    help="Run this part alone; repeat it for several.",
)
@click.option(
    "--seed",
    type=click.IntRange(1),
    default=FIRST_SEED,
    show_default=True,
    help="Number of the first simulated axis, and first seed of the second plant.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Number of axes or seeds, from --seed on.",
)
@click.option(
    "--healthy-minutes",
    type=click.FloatRange(1.0),
    help="Length of the healthy production, minutes [default: 300].",
)
@click.option(
    "--second-plant",
    type=PATH,
    help="Folder with the commands of a second plant [default: shared/bench beside the checkout].",
)
@click.option(
    "--processes",
    type=click.IntRange(1),
    default=PROCESSES,
    show_default=True,
    help="Number of processes that share the work.",
)
@click.option("--plots", type=PATH, help="Draw lives and rates into this folder.")
@JSON
@click.option(
    "--pictures",
    type=PATH,
    help="Draw the rows into this folder instead of measuring.",
)
def bench_estimator(
    quick: bool,
    only: tuple[str, ...],
    seed: int,
    seeds: int,
    healthy_minutes: float | None,
    second_plant: Path | None,
    processes: int,
    plots: Path | None,
    as_json: bool,
    pictures: Path | None,
) -> None:
    """Measure the preload estimate against plants whose truth is known, beside what was aimed at.

    Parts: own, foreign, thesis and spoiled are single recordings with aims; life is many sessions
    over months, rates is wear of any speed, healthy counts false conditions, second-plant runs a
    benchmark that lies beside the checkout, ablation takes the estimator's parts away one by one.
    """
    from .estimator.bench import run_estimator_bench
    from .estimator.plants.second_plant import SecondPlantError
    from .estimator.tasks import BenchSettings

    if pictures is not None:
        from .estimator.pictures import draw_estimator

        for file in draw_estimator(pictures, quick, progress):
            click.echo(file)
        return
    settings = BenchSettings(
        quick=quick,
        parts=only or PARTS,
        seed=seed,
        seeds=seeds,
        healthy_minutes=healthy_minutes,
        processes=processes,
    )
    if second_plant is not None:
        settings = replace(settings, second_plant=second_plant)
    if only == ("second-plant",):
        _require_second_plant(settings.second_plant)
    try:
        found = run_estimator_bench(settings, progress)
    except SecondPlantError as error:
        raise InputError(f"--second-plant {settings.second_plant}: {error}") from None
    if plots is not None:
        from .estimator.pictures import draw_rows

        for name, rows in (found.drawn or {}).items():
            draw_rows(plots, rows, f"{name}.png", progress)
    click.echo(found.as_json() if as_json else found.as_text())


def _require_second_plant(folder: Path) -> None:
    from .estimator.plants.second_plant import MAKE, has_second_plant

    if not has_second_plant(folder):
        raise InputError(f"--second-plant {folder}: no {MAKE} in it")


@bench.command("diagnose", epilog="Example: edge-service bench diagnose --cases 20")
@click.option(
    "--cases",
    type=click.IntRange(1),
    default=500,
    show_default=True,
    help="Number of simulated cases.",
)
@click.option(
    "--seed",
    type=int,
    default=0,
    show_default=True,
    help="Start of the random numbers that draw the cases.",
)
@click.option(
    "--out",
    type=PATH,
    help="Write each case to this file, a line of JSON each.",
)
@click.option(
    "--pictures",
    type=PATH,
    help="Draw reliability and confusion into this folder.",
)
@click.option(
    "--ties",
    type=click.IntRange(1),
    help="Measure on this many ties instead how often a proposed motion settles them.",
)
@click.option(
    "--second-plant",
    is_flag=True,
    help="Run the benchmark in shared/bench beside the checkout instead, whole and thinned.",
)
@click.option(
    "--quick", is_flag=True, help="With --second-plant: run a dozen cases at two rates only."
)
@click.option(
    "--real-machines",
    is_flag=True,
    help="Use recordings in shared/data beside the checkout instead, with errors added.",
)
def bench_diagnose(
    cases: int,
    seed: int,
    out: Path | None,
    pictures: Path | None,
    ties: int | None,
    second_plant: bool,
    quick: bool,
    real_machines: bool,
) -> None:
    """Score the diagnosis on a plant that shares no code with the library (checkout only)."""
    if second_plant:
        click.echo(_diagnosis_plant(seed, quick, out))
        return
    if real_machines:
        click.echo(_real_machines(seed, out))
        return
    if ties is not None:
        from .diagnose.ties import run_ties

        click.echo(run_ties(ties, out, seed, progress))
        return
    from .diagnose.bench import run_diagnose_bench

    click.echo(run_diagnose_bench(cases, out, seed=seed, pictures=pictures, progress=progress))


def _diagnosis_plant(seed: int, quick: bool, out: Path | None) -> str:
    from .diagnose.second_plant import MAKE, has_diagnosis_plant, run_diagnosis_plant
    from .estimator.plants.second_plant import BESIDE, SecondPlantError

    if not has_diagnosis_plant(BESIDE):
        raise InputError(f"--second-plant: no {MAKE} in {BESIDE}")
    try:
        return run_diagnosis_plant(BESIDE, seed, quick, out, progress)
    except SecondPlantError as error:
        raise InputError(f"--second-plant: {error}") from None


def _real_machines(seed: int, out: Path | None) -> str:
    from .diagnose.cases import BenchError
    from .diagnose.real.seeded_errors import run_seeded_errors
    from .real_machines import DATA

    try:
        return run_seeded_errors(DATA, seed, out, say=progress)
    except BenchError as error:
        raise InputError(f"--real-machines: {error}") from None


@bench.command("speed", epilog="Example: edge-service bench speed --quick")
@QUICK
@click.option(
    "--only",
    type=click.Choice(SPEED_PARTS),
    multiple=True,
    help="Measure this part alone; repeat it for several.",
)
@JSON
def bench_speed(quick: bool, only: tuple[str, ...], as_json: bool) -> None:
    """Measure speed beside a peer and beside the bare parts, in the same run."""
    from .speed.bench import SpeedSettings, run_speed_bench

    table = run_speed_bench(SpeedSettings(only or SPEED_PARTS, quick), progress)
    click.echo(json.dumps(table.as_dict(), indent=2) if as_json else table.as_text())


@bench.command("drivers", epilog="Example: edge-service bench drivers --quick")
@QUICK
@JSON
def bench_drivers(quick: bool, as_json: bool) -> None:
    """Measure polls and notifications, many devices in one process, and one that hangs."""
    from .pipeline.drivers import DriversBenchSettings, run_drivers_bench

    figures = run_drivers_bench(DriversBenchSettings(quick=quick), progress)
    click.echo(json.dumps(figures.as_dict(), indent=2) if as_json else figures.as_text())
