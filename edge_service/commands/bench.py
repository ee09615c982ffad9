"""Commands that measure: speed and size, and how right the answers are."""

import json
from pathlib import Path

import click

from ..studies.benches import BENCHES, Bench, BenchReport
from .options import InputError
from .terminal import progress


@click.group(invoke_without_command=True, epilog="Example: edge-service bench identification")
@click.option("--quick", is_flag=True, help="Shorter measurements.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
@click.pass_context
def bench(context: click.Context, quick: bool, as_json: bool) -> None:
    """Measure speed and size: start, CPU, memory, delay, replay, estimator steps.

    The sub-commands measure how right the answers are.
    """
    if context.invoked_subcommand is not None:
        if quick or as_json:
            raise InputError(f"bench: options of {context.invoked_subcommand} come after its name")
        return
    from ..studies.pipeline_bench import PipelineBenchSettings, run_pipeline_bench

    _print_report(run_pipeline_bench(PipelineBenchSettings(quick=quick), progress), as_json)


def _print_report(report: BenchReport, as_json: bool) -> None:
    click.echo(json.dumps(report.as_dict(), indent=2) if as_json else report.as_text())


def _bench_command(each: Bench) -> click.Command:
    @click.command(
        each.name,
        help=each.purpose,
        epilog=f"Example: edge-service bench {each.name} --seeds {each.seeds // 10}",
    )
    @click.option(
        "--seeds", type=click.IntRange(1), default=each.seeds, show_default=True, help="Axes."
    )
    @click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
    def command(seeds: int, as_json: bool) -> None:
        _print_report(each.run(seeds, progress), as_json)

    return command


for _each in BENCHES:
    bench.add_command(_bench_command(_each))


@bench.command("estimator", epilog="Example: edge-service bench estimator --quick")
@click.option("--quick", is_flag=True, help="Fewer axes, shorter runs.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
@click.option("--pictures", type=click.Path(path_type=Path), help="Folder: draw the rows instead.")
def bench_estimator(quick: bool, as_json: bool, pictures: Path | None) -> None:
    """Measure the preload estimate against two plants, beside the seed's and what was aimed at."""
    from ..studies.estimator_bench import run_estimator_bench
    from ..studies.estimator_foreign import CHECKOUT_TESTS
    from ..studies.estimator_pictures import draw_estimator

    if pictures is not None:
        for file in draw_estimator(pictures, CHECKOUT_TESTS, quick, progress):
            click.echo(file)
        return
    table = run_estimator_bench(quick, progress)
    click.echo(table.as_json() if as_json else table.as_text())


@bench.command("diagnose", epilog="Example: edge-service bench diagnose --cases 20")
@click.option("--cases", type=click.IntRange(1), default=500, show_default=True, help="Cases.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the mixture of cases.")
@click.option("--out", type=click.Path(path_type=Path), help="Each case as a line of JSON.")
@click.option("--pictures", type=click.Path(path_type=Path), help="Folder: reliability, confusion.")
@click.option("--ties", type=click.IntRange(1), help="Instead: do proposed motions settle ties?")
def bench_diagnose(
    cases: int, seed: int, out: Path | None, pictures: Path | None, ties: int | None
) -> None:
    """Score the diagnosis on a plant that shares no code with the library (checkout only)."""
    if ties is not None:
        from ..studies.diagnose_ties import run_ties

        click.echo(run_ties(ties, out, seed, progress))
        return
    from ..studies.diagnose_bench import run_diagnose_bench

    click.echo(run_diagnose_bench(cases, out, seed=seed, pictures=pictures, progress=progress))


@bench.command("drivers", epilog="Example: edge-service bench drivers --quick")
@click.option("--quick", is_flag=True, help="Shorter measurements.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
def bench_drivers(quick: bool, as_json: bool) -> None:
    """Measure polls and notifications, many devices in one process, and one that hangs."""
    from ..studies.drivers_bench import DriversBenchSettings, run_drivers_bench

    figures = run_drivers_bench(DriversBenchSettings(quick=quick), progress)
    click.echo(json.dumps(figures.as_dict(), indent=2) if as_json else figures.as_text())
