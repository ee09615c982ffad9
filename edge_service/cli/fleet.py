"""Commands that show the axes of many services, and run what a plant needs to show its own."""

import asyncio
import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..command_answer import Answer
from .options import PATH, InputError, answering
from .terminal import announce, log_to_stderr, progress, wants_json

if TYPE_CHECKING:
    from ..bus.plant.session import PlantSettings
    from ..config_tables import FleetConfig
    from ..health.fleet.rows import FleetRow

_ANSWER_S = 3.0
"""Time in which fleet nodes answer what they hold ready; only one that is silent takes it up."""
Shown = tuple[Sequence["FleetRow"], Sequence[str], Any]
"""Rows, sentences on what is not shown, and the document."""


@click.command(
    epilog="Example: edge-service fleet http://127.0.0.1:8080 --services fleet.toml, or of a plant "
    "edge-service fleet --plant tcp/127.0.0.1:7450"
)
@click.argument("addresses", nargs=-1)
@click.option("--services", type=PATH, help="TOML file that lists the services as [[services]].")
@click.option("--plant", "endpoint", help="Router of a plant whose fleet nodes are asked instead.")
@click.option(
    "--certificates",
    type=PATH,
    help="Folder of `edge-service certs`, whose `reader` is shown to --plant tls/...",
)
@click.option("--allow-plain", is_flag=True, help="Let --plant tcp/... leave this machine.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.1, 60.0),
    help="Wait this many seconds for all answers [default: 5, with --plant 3].",
)
@click.option(
    "--watch", "period_s", type=click.FloatRange(1.0), help="Repeat every so many seconds."
)
@answering
def fleet(
    addresses: tuple[str, ...],
    services: Path | None,
    endpoint: str | None,
    certificates: Path | None,
    allow_plain: bool,
    timeout_s: float | None,
    period_s: float | None,
) -> Iterator[Answer]:
    """Show the axes of many services in one table, the worst first.

    They are asked one by one, or with --plant the fleet nodes of a plant are.
    """
    on_terminal = sys.stdout.isatty() and not wants_json()
    if endpoint is None:
        look = partial(_services, _fleet_of(addresses, services, timeout_s))
    elif addresses or services is not None:
        raise InputError("--plant: goes without addresses and --services")
    else:
        settings = _plant_of(endpoint, certificates, allow_plain)
        look = partial(_plant, settings, _ANSWER_S if timeout_s is None else timeout_s)
    while True:
        rows, notes, document = look()
        if period_s is not None and on_terminal:
            click.clear()
        table = _drawn(rows) if on_terminal else _table(rows)
        yield Answer("\n".join([*notes, table]), document)
        if period_s is None:
            return
        time.sleep(period_s)


def _table(rows: Sequence["FleetRow"]) -> str:
    """The table for a pipe."""
    from ..offline.fleet.table import table_of

    return table_of(rows)


def _services(settings: "FleetConfig") -> Shown:
    """Rows of the services, each asked for itself."""
    from ..offline.fleet.ask import ask_fleet
    from ..offline.fleet.table import Fleet

    progress(f"asking {len(settings.services)} services")
    rows = ask_fleet(settings)
    return rows, (), Fleet.of(rows)


def _plant(settings: "PlantSettings", timeout_s: float) -> Shown:
    """Rows of a plant from its fleet nodes, and what is not shown."""
    from ..bus.plant.session import PlantAwayError
    from ..offline.fleet.plant import ask_plant
    from ..offline.fleet.table import Plant

    progress("asking the fleet nodes")
    try:
        table = asyncio.run(ask_plant(settings, timeout_s))
    except PlantAwayError as error:
        raise InputError(str(error)) from None
    return table.rows, table.missing, Plant.of(table)


def _plant_of(endpoint: str, certificates: Path | None, allow_plain: bool) -> "PlantSettings":
    from ..bus.plant.session import PlantSettings, PlantSettingsError
    from ..bus.settings import TlsSettings

    try:
        files = None
        if certificates is not None:
            files = TlsSettings.of_folder(endpoint, certificates, "reader")
        return PlantSettings(endpoint, files, allow_plain)
    except PlantSettingsError as error:
        raise InputError(f"--plant: {error}") from None
    except OSError as error:
        raise InputError(f"--certificates: {error.filename}: {error.strerror}") from None


def _drawn(rows: Sequence["FleetRow"]) -> str:
    """The table in the colours and the width of this terminal."""
    from rich.console import Console

    from ..offline.fleet.table import terminal_table

    console = Console(highlight=False)
    with console.capture() as drawn:
        console.print(terminal_table(rows))
    return drawn.get().rstrip("\n")


def _fleet_of(
    addresses: tuple[str, ...], services: Path | None, timeout_s: float | None
) -> "FleetConfig":
    """Services that are named, and those of the file."""
    from pydantic import ValidationError

    from ..config import explain, load_fleet
    from ..config_tables import FleetConfig, FleetServiceConfig

    if not addresses and services is None:
        raise InputError("fleet: expected addresses, or --services with a file of them")
    try:
        named = tuple(FleetServiceConfig(address=each) for each in addresses)
    except ValidationError as error:
        raise InputError(f"fleet: {explain(error, FleetServiceConfig)}") from None
    listed = FleetConfig(services=named) if services is None else load_fleet(services)
    every = listed.services if services is None else (*named, *listed.services)
    wanted = listed.timeout_s if timeout_s is None else timeout_s
    return FleetConfig(timeout_s=wanted, services=every)


@click.group(epilog="Example: edge-service plant node fleet-1.toml")
def plant() -> None:
    """Run what a plant needs beside its machines: routers, and fleet nodes that read them."""


@plant.command(epilog="Example: edge-service plant node fleet-1.toml")
@click.argument("config", type=PATH)
def node(config: Path) -> None:
    """Run a fleet node: it reads its share of the plant and shows all of it."""
    from ..config import load_fleet_node
    from ..nodes.fleet.node import run_fleet_node

    log_to_stderr()
    asyncio.run(run_fleet_node(load_fleet_node(config), announce))


@plant.command(
    epilog="Example: edge-service plant router --listen tls/0.0.0.0:7447 --certificates certs"
)
@click.option("--listen", multiple=True, required=True, help="Endpoint at which others connect.")
@click.option("--connect", multiple=True, help="Endpoint of a router above this one.")
@click.option(
    "--certificates", type=PATH, help="Folder with ca.pem, server.pem and server.key for TLS."
)
@click.option("--allow-plain", is_flag=True, help="Let TCP leave this machine unencrypted.")
def router(
    listen: tuple[str, ...], connect: tuple[str, ...], certificates: Path | None, allow_plain: bool
) -> None:
    """Run a router of the plant, until it is interrupted; `zenohd` does as well."""
    from ..bus.plant.session import PlantSettingsError
    from ..bus.settings import TlsSettings
    from ..nodes.fleet.router import run_router

    log_to_stderr()
    try:
        files = None
        if certificates is not None:
            files = TlsSettings.of_folder(listen[0], certificates, "server")
        asyncio.run(run_router(listen, connect, files, allow_plain, announce))
    except PlantSettingsError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from None
