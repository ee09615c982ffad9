"""The command that shows the axes of many services."""

import sys
import time
from pathlib import Path

import click
from pydantic import ValidationError

from ..config import explain, load_fleet
from ..config_tables import FleetConfig, FleetServiceConfig
from .options import PATH, InputError, json_option


@click.command(epilog="Example: edge-service fleet http://127.0.0.1:8080 --services fleet.toml")
@click.argument("addresses", nargs=-1)
@click.option("--services", type=PATH, help="TOML file that lists the services as [[services]].")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.1, 60.0),
    help="Wait this many seconds for all answers [default: 5].",
)
@json_option("Print the rows as JSON, one line per round.")
@click.option(
    "--watch", "period_s", type=click.FloatRange(1.0), help="Repeat every so many seconds."
)
def fleet(
    addresses: tuple[str, ...],
    services: Path | None,
    timeout_s: float | None,
    as_json: bool,
    period_s: float | None,
) -> None:
    """Show the axes of many services in one table, the worst first."""
    from rich.console import Console

    from ..offline.fleet.ask import ask_fleet
    from ..offline.fleet.table import as_json_line, table_of, terminal_table

    on_terminal = sys.stdout.isatty() and not as_json
    settings = _fleet_of(addresses, services, timeout_s)
    while True:
        rows = ask_fleet(settings)
        if period_s is not None and on_terminal:
            click.clear()
        if on_terminal:
            Console(highlight=False).print(terminal_table(rows))
        else:
            click.echo(as_json_line(rows) if as_json else table_of(rows))
        if period_s is None:
            return
        sys.stdout.flush()
        time.sleep(period_s)


def _fleet_of(
    addresses: tuple[str, ...], services: Path | None, timeout_s: float | None
) -> FleetConfig:
    """Services that are named, and those of the file."""
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
