"""Command that shows the axes of many machines."""

import sys
import time
from collections.abc import Iterator

import click

from ..command_answer import Answer
from .options import InputError, answering
from .terminal import progress, wants_json


@click.command(epilog="Example: edge-service fleet tcp/router.plant:7447 --watch 10")
@click.argument("addresses", nargs=-1, required=True, metavar="ADDRESS...")
@click.option("--watch", "period_s", type=click.FloatRange(1.0), help="Repeat after so many s.")
@answering
def fleet(addresses: tuple[str, ...], period_s: float | None) -> Iterator[Answer]:
    """Show the axes of many machines in one table, the worst first.

    ADDRESS is that of a service (http://, https://; its token by .netrc) or of a Zenoh router
    (tcp/HOST:PORT, tls/HOST:PORT; certificates by ZENOH_CONFIG).
    """
    from rich.console import Console

    from ..offline.fleet import FleetWatch, table_of

    on_terminal = sys.stdout.isatty() and not wants_json()
    console = Console(highlight=False, width=None if on_terminal else 200)
    try:
        watch = FleetWatch(addresses)
    except (ValueError, SyntaxError) as error:
        raise InputError(str(error)) from None
    try:
        while True:
            progress(f"asking {len(addresses)} addresses")
            found = watch.look()
            if period_s is not None and on_terminal:
                click.clear()
            with console.capture() as drawn:
                console.print(table_of(found))
            yield Answer(drawn.get().rstrip("\n"), found)
            if period_s is None:
                return
            time.sleep(period_s)
    finally:
        watch.close()
