"""Commands that learn a healthy axis and estimate its preload from recordings."""

from functools import partial
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    MACHINE,
    PATH,
    TRACES,
    Batch,
    InputError,
    answering,
    batch_options,
    configured,
    out_option,
    service_config_option,
)
from .terminal import progress


@click.command(
    epilog="Example: edge-service commission --machine m.toml healthy.csv --out commissioned.toml"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@out_option("Machine file to write.")
@click.option(
    "--assume-fresh",
    is_flag=True,
    help="Treat the screw as fresh although recordings or data sheet say otherwise.",
)
@click.option(
    "--interval",
    "interval_s",
    type=click.FloatRange(0.001, 10.0),
    show_default="0.1",
    help="Length of the blocks that the estimator takes, s; kept in the machine file.",
)
@answering
def commission(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    assume_fresh: bool,
    interval_s: float | None,
) -> Answer:
    """Learn from recordings of a healthy, cold axis what the estimator needs."""
    from ..offline.commission import commission_to_file

    return commission_to_file(
        machine,
        traces,
        out,
        axis_number,
        assume_fresh=assume_fresh,
        interval_s=interval_s,
        progress=progress,
    )


@click.command(
    epilog="Example: edge-service estimate --machine m.toml trace.csv --out estimates.csv"
)
@TRACES
@MACHINE
@AXIS_NUMBER
@out_option("CSV file to write, one row per block; a folder with --each.")
@service_config_option("Service configuration with the estimator's settings.")
@click.option(
    "--state",
    type=PATH,
    help="Continue from the state in this file if it exists; write the new state to it.",
)
@answering
@batch_options("estimates.csv")
def estimate(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    out: Path,
    config: Path | None,
    state: Path | None,
    batch: Batch | None,
) -> Answer:
    """Run the live estimator over a recording as fast as it can."""
    from ..offline.estimate import estimate_case, estimate_to_csv

    service = configured(config)
    if batch is not None:
        if state is not None:
            raise InputError("--state: goes with one recording, not with --each")
        work = partial(estimate_case, machine, config=service, axis_number=axis_number)
        return batch(work, traces, out)
    if len(traces) > 1:
        raise InputError("estimate takes one recording; several are cases of their own with --each")
    return estimate_to_csv(traces[0], machine, out, service, state, axis_number, progress)
