"""The command that measures: speed and size, and how right the answers are."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from edge_service.cli.options import FLAG, PATH, InputError
from edge_service.cli.terminal import progress

from .estimator.parts import FIRST_SEED, PARTS
from .speed.parts_of import SPEED_PARTS

if TYPE_CHECKING:
    from .table import Figures

PARTS_OF: dict[str, tuple[str, ...]] = {
    "speed": SPEED_PARTS,
    "diagnose": ("foreign", "second-plant", "real-machines"),
    "drivers": (),
    "estimator": PARTS,
    "identification": (),
}
"""Benchmarks and their parts."""
QUICK_CASES, CASES = 20, 500
QUICK_AXES, AXES = 10, 100


@click.command(epilog="Example: edge-service bench estimator --quick --only life")
@click.argument("name", type=click.Choice(tuple(PARTS_OF)), default="speed")
@click.option("--quick", is_flag=True, help="Measure less, for a shorter time.")
@click.option("--only", multiple=True, metavar="PART", help="This part alone; may be repeated.")
@click.option("--seed", type=int, default=FIRST_SEED, show_default=True, help="First seed.")
@click.option(
    "--seeds", type=click.IntRange(1), default=1, show_default=True, help="Number of seeds."
)
@click.option("--out", type=PATH, help="File for the cases of a diagnosis, a line of JSON each.")
@click.option(FLAG, "as_json", is_flag=True, help="Print the figures as JSON.")
def bench(
    name: str,
    quick: bool,
    only: tuple[str, ...],
    seed: int,
    seeds: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Measure speed, memory and accuracy.

    speed: beside a peer and the bare parts. diagnose: causes named on plants that share no code
    with the library. drivers: polls and notifications. estimator: the preload beside its truth.
    identification: parameters beside their truth.
    """
    unknown = [each for each in only if each not in PARTS_OF[name]]
    if unknown:
        there = ", ".join(PARTS_OF[name]) or "none"
        raise InputError(f"--only {unknown[0]}: no part of {name}; there are {there}")
    if name == "diagnose":
        if as_json:
            raise InputError("bench diagnose: its table has no JSON; expected --out FILE")
        click.echo(_diagnose(only or ("foreign",), seed, quick, out))
        return
    found = _figures(name, only or PARTS_OF[name], quick, seed, seeds)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else found.as_text())


def _figures(name: str, parts: tuple[str, ...], quick: bool, seed: int, seeds: int) -> "Figures":
    if name == "speed":
        from .speed.bench import SpeedSettings, run_speed_bench

        return run_speed_bench(SpeedSettings(parts, quick), progress)
    if name == "drivers":
        from .drivers.bench import DriversBenchSettings, run_drivers_bench

        return run_drivers_bench(DriversBenchSettings(quick=quick), progress)
    if name == "identification":
        from .identification.bench import run

        return run(QUICK_AXES if quick else AXES, progress)
    from .estimator.bench import run_estimator_bench
    from .estimator.tasks import BenchSettings

    return run_estimator_bench(BenchSettings(quick, parts, seed, seeds), progress)


def _diagnose(parts: tuple[str, ...], seed: int, quick: bool, out: Path | None) -> str:
    from .diagnose.bench import run_diagnose_bench
    from .diagnose.cases import BenchError
    from .diagnose.real.seeded_errors import run_seeded_errors
    from .diagnose.second_plant import MAKE, has_diagnosis_plant, run_diagnosis_plant
    from .estimator.plants.second_plant import BESIDE, SecondPlantError
    from .real_machines import DATA

    if "second-plant" in parts and not has_diagnosis_plant(BESIDE):
        raise InputError(f"bench diagnose: no {MAKE} in {BESIDE}")
    benches: dict[str, Callable[[], str]] = {
        "foreign": lambda: run_diagnose_bench(
            QUICK_CASES if quick else CASES, out, seed=seed, progress=progress
        ),
        "second-plant": lambda: run_diagnosis_plant(BESIDE, seed, quick, out, progress),
        "real-machines": lambda: run_seeded_errors(DATA, seed, out, say=progress),
    }
    try:
        return "\n\n".join(benches[part]() for part in parts)
    except (BenchError, SecondPlantError) as error:
        raise InputError(f"bench diagnose: {error}") from None
