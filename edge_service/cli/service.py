"""Commands that run the service, check what it would run, or copy what it keeps."""

import asyncio
from dataclasses import replace
from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    BUS,
    CONFIG,
    MACHINE,
    PATH,
    PORT,
    TRACE,
    InputError,
    answering,
    configured,
    out_option,
    service_config_option,
)
from .terminal import announce, log_to_stderr, progress


@click.command(epilog="Example: edge-service run deploy/edge.toml --port 8080")
@CONFIG
@PORT
@BUS
def run(config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run all nodes in one process: drives, bus, downsampling, estimator, health, HTTP.

    Without CONFIG, run a simulated drive with the built-in default configuration.
    """
    from ..nodes.service import run_service

    log_to_stderr()
    asyncio.run(run_service(configured(config, port, endpoint), announce))


@click.command(epilog="Example: edge-service node bus edge.toml & edge-service node http edge.toml")
@click.argument("name")
@CONFIG
@PORT
@BUS
def node(name: str, config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run a single node: bus, acquire, downsample, estimate, health, http or an output.

    `bus` is the router that all others connect to.

    Nodes identify themselves by certificates (`edge-service certs`), unless the bus is open.
    """
    from ..nodes.service import run_node

    log_to_stderr()
    settings = configured(config, port, endpoint)
    asyncio.run(run_node(settings, name, announce))


@click.command("check-config", epilog="Example: edge-service check-config deploy/edge.toml")
@CONFIG
@answering
def check_config(config: Path | None) -> Answer:
    """Check a configuration, its machine files and driver settings, and sum it up."""
    from ..config import DEFAULT_CONFIG
    from ..offline.configuration import check_configuration

    progress("checking configuration and sources")
    checked = check_configuration(config or DEFAULT_CONFIG)
    return replace(checked, words=f"{checked.words}\nconfiguration is right")


@click.command(
    epilog="Example: edge-service replay --machine deploy/emps.toml trace.csv --speed 10"
)
@TRACE
@MACHINE
@AXIS_NUMBER
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    help="Speed as a multiple of real time; 0 is as fast as possible.",
)
@click.option("--loop", is_flag=True, help="Begin again at the end of the recording.")
@click.option("--hold", is_flag=True, help="Keep serving after the end of the recording.")
@service_config_option("Service configuration; its axes are not used.")
@PORT
@BUS
@answering
def replay(
    trace: Path,
    machine: Path,
    axis_number: int | None,
    speed: float,
    loop: bool,
    hold: bool,
    config: Path | None,
    port: int | None,
    endpoint: str | None,
) -> Answer:
    """Play a recording through the whole service, and print the final answer."""
    from ..offline.replay import replay_trace

    log_to_stderr()
    if speed < 0.0:
        raise InputError(f"--speed: {speed:g}, expected 0 or more")
    settings = configured(config, port, endpoint)
    return asyncio.run(
        replay_trace(
            settings,
            trace,
            machine,
            speed,
            loop=loop,
            hold=hold,
            announce=announce,
            axis_number=axis_number,
        )
    )


@click.command(epilog="Example: edge-service backup /etc/edge-service/edge.toml --out backup.zip")
@click.argument("config", type=PATH)
@out_option("File to write; it may hold secrets, and is for its owner alone.")
@click.option("--recordings", is_flag=True, help="Keep the recordings as well.")
@answering
def backup(config: Path, out: Path, recordings: bool) -> Answer:
    """Copy configuration and history while the service runs."""
    from ..offline.backup import back_up

    progress("copying")
    return back_up(config, out, recordings=recordings)


@click.command(epilog="Example: edge-service restore backup.zip /etc/edge-service/edge.toml")
@click.argument("archive", type=PATH)
@click.argument("config", type=PATH)
@click.option(
    "--force", is_flag=True, help="Replace what differs; it stays beside, as NAME.before-TIME."
)
@answering
def restore(archive: Path, config: Path, force: bool) -> Answer:
    """Put a backup in place, whole or not at all.

    CONFIG is the configuration to write, with the files that it names beside it; the history goes
    where that configuration keeps it. No service may be running on it.
    """
    from ..offline import backup as backups

    progress("checking the backup")
    return backups.restore(archive, config, force=force)
