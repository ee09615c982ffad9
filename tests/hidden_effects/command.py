"""`edge-service check-diagnosis`: how it is asked."""

from pathlib import Path
from typing import Annotated, Literal

import click

from edge_service.cli.options import Effects, Option, Seed, Without, command
from edge_service.cli.terminal import progress
from edge_service.command_answer import Answer


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
) -> Answer:
    """Score the diagnosis on hidden effects, truth beside answer.

    A plant records an axis with effects that are drawn, or given; the diagnosis is told of none.
    What it names goes into the model, and the gap is measured on another recording. The foreign
    plant draws the values of its effects itself.
    """
    from .score import check_diagnosis as run

    return run(plant, machine, effects, without, seed or 0, cases, progress)
