"""Command that shows the axes of many services."""

import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..command_answer import Answer
from .options import PATH, InputError, answering
from .terminal import progress, wants_json

if TYPE_CHECKING:
    from ..config_tables import FleetConfig
    from ..health.fleet.rows import FleetRow

Shown = tuple[Sequence["FleetRow"], Sequence[str], Any]
"""Rows, sentences on what is not shown, and the document."""


@click.command(epilog="Example: edge-service fleet http://127.0.0.1:8080 --services fleet.toml")
@click.argument("addresses", nargs=-1)
@click.option("--services", type=PATH, help="TOML file that lists the services as [[services]].")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.1, 60.0),
    help="Wait this many seconds for all answers [default: 5].",
)
@click.option(
    "--watch", "period_s", type=click.FloatRange(1.0), help="Repeat every so many seconds."
)
@answering
def fleet(
    addresses: tuple[str, ...],
    services: Path | None,
    timeout_s: float | None,
    period_s: float | None,
) -> Iterator[Answer]:
    """Show the axes of many services in one table, the worst first."""
    on_terminal = sys.stdout.isatty() and not wants_json()
    look = partial(_services, _fleet_of(addresses, services, timeout_s))
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
