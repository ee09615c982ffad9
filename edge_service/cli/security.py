"""Commands about who may do what: certificates."""

from datetime import datetime
from pathlib import Path

import click

from ..exit_status import DONE


@click.command(
    epilog="Example: edge-service certs --out certificates --name edge-box --name 192.168.1.5"
)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write to.")
@click.option("--name", "names", multiple=True, help="Host name or address of this machine.")
@click.option(
    "--days", type=click.IntRange(1, 3650), default=825, show_default=True, help="Validity."
)
def certs(out: Path, names: tuple[str, ...], days: int) -> int:
    """Make certificates: a local authority, a server (page and bus), and each role on the bus.

    The authority of the folder is used again if it is there, so that nobody needs to trust it anew.
    """
    from ..bus.access import PUTS, client_name
    from ..certificates import expiry, make_certificates

    clients = {role: client_name(role) for role in PUTS}
    for path in make_certificates(out, names, clients, days):
        click.echo(f"{path}: until {_day(expiry(path))}")
    click.echo(f"browsers and clients must trust {out / 'ca.pem'}; keep {out / 'ca.key'} elsewhere")
    return DONE


def _day(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%d")
