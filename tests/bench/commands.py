"""The command that measures: speed and size, and how right the answers are."""

import json
import signal
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from edge_service.cli.options import FLAG
from edge_service.cli.terminal import progress
from edge_service.exit_status import BadInputError

from .estimator.parts import FIRST_SEED, PARTS
from .speed.parts_of import SPEED_PARTS

if TYPE_CHECKING:
    from .table import Table

PARTS_OF: dict[str, tuple[str, ...]] = {
    "speed": SPEED_PARTS,
    "diagnose": ("foreign", "real-machines"),
    "drivers": (),
    "estimator": PARTS,
    "identification": (),
}
"""Benchmarks and their parts."""
NOT_BESIDE_OTHERS = {"soak", "real-machines"}
"""Parts that are measured only where they are asked for: an hour, or what lies elsewhere."""


@click.command(epilog="Example: edge-service bench estimator --quick --only life")
@click.argument("name", type=click.Choice(tuple(PARTS_OF)), default="speed")
@click.option("--quick", is_flag=True, help="Measure less, for a shorter time.")
@click.option("--only", multiple=True, metavar="PART", help="This part alone; may be repeated.")
@click.option("--seed", type=int, default=FIRST_SEED, show_default=True, help="First seed.")
@click.option("--seeds", type=click.IntRange(1), default=1, show_default=True, help="How many.")
@click.option(FLAG, "as_json", is_flag=True, help="Print the tables as JSON.")
def bench(
    name: str, quick: bool, only: tuple[str, ...], seed: int, seeds: int, as_json: bool
) -> None:
    """Measure speed, memory and accuracy.

    speed: beside a peer and the bare parts. diagnose: causes named on plants that share no code
    with the library. drivers: polls and notifications. estimator: the preload beside its truth.
    identification: parameters beside their truth.
    """
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # ends what it started
    parts = PARTS_OF[name]
    unknown = [each for each in only if each not in parts]
    if unknown:
        there = ", ".join(parts) or "none"
        raise BadInputError(f"--only {unknown[0]}: no part of {name}; there are {there}")
    chosen = only or tuple(part for part in parts if part not in NOT_BESIDE_OTHERS)
    tables = _tables(name, chosen, quick, seed, seeds)
    if as_json:
        click.echo(json.dumps({"tables": [table.document() for table in tables]}, allow_nan=False))
    else:
        click.echo("\n\n".join(str(table) for table in tables))


def _tables(
    name: str, parts: Sequence[str], quick: bool, seed: int, seeds: int
) -> Sequence["Table"]:
    if name == "speed":
        from .speed.bench import run_speed_bench

        return [run_speed_bench(parts, quick, progress)]
    if name == "drivers":
        from .drivers.bench import run_drivers_bench

        return [run_drivers_bench(quick, progress)]
    if name == "identification":
        from .identification.bench import run, table_of

        return [table_of(run(10 if quick else 100, progress))]
    if name == "diagnose":
        from .diagnose.bench import run_diagnose_bench

        return run_diagnose_bench(parts, quick, seed, progress)
    from .estimator.bench import run_estimator_bench

    return run_estimator_bench(parts, quick, progress, seed, seeds)
