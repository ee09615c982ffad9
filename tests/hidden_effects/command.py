"""`edge-service check-diagnosis`: how it is asked."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Literal

import click

from edge_service.cli.options import Effects, Option, Seed, Without, command
from edge_service.cli.terminal import pause_progress, progress, wants_json
from edge_service.command_answer import Answer
from edge_service.exit_status import BadInputError


@command("check-diagnosis --effect stribeck --effect backlash --seed 7", "check-diagnosis")
def check_diagnosis(
    machine: Annotated[
        Path | None, Option("Machine file of the own plant.  [default: the thesis' test bench]")
    ],
    effects: Effects,
    without: Without,
    plant: Annotated[
        Literal["own", "foreign"],
        Option("Simulated axis of this package, or one that shares no code with it."),
    ] = "foreign",
    seed: Seed = 1,
    cases: Annotated[int, Option("Number of recordings.", kind=click.IntRange(1, 10_000))] = 8,
    jobs: Annotated[int, Option("Number of processes.", kind=click.IntRange(1, 1024))] = 1,
) -> Answer:
    """Score the diagnosis on hidden effects, truth beside answer.

    A plant records an axis with effects that are drawn, or given; the diagnosis is told of none.
    What it names goes into the model, and the gap is measured on another recording. The foreign
    plant draws the values of its effects itself.
    """
    from .cases import foreign_plant, own_plant, plan
    from .score import checked, total_lines, totals_of

    if plant != "own" and machine is not None:
        raise BadInputError("--machine: the foreign plant has a machine file of its own")
    axis, rows = foreign_plant() if plant != "own" else own_plant(machine), []
    planned = plan(axis, cases, seed or 0, effects, without)
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for row in (map if jobs == 1 else pool.map)(partial(checked, axis), planned):
            rows.append(row)
            if not wants_json():
                pause_progress()
                click.echo(row.words)
            progress(f"{len(rows)} of {cases} cases: {100 * len(rows) // cases} %")
    totals = totals_of(rows)
    document = {"cases": [row.document for row in rows], "totals": totals}
    return Answer("\n".join(total_lines(totals)), document)
