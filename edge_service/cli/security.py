"""Commands about who may do what: certificates and tokens."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from ..exit_status import INTERNAL_FAILURE
from .audited import HISTORY, noted
from .options import PATH, InputError, answering
from .terminal import progress

if TYPE_CHECKING:
    from ..http_api.security.tokens import RoleName


@dataclass(frozen=True, slots=True)
class Certificates:
    """Files that were written, each with the day until which it holds."""

    until: dict[str, str]
    authority: str


@dataclass(frozen=True, slots=True)
class AddedToken:
    """The only place where the token itself is shown."""

    file: str
    name: str
    role: str
    token: str


@dataclass(frozen=True, slots=True)
class ListedToken:
    """One token; the dates are days in UTC."""

    name: str
    role: str
    created: str
    expires: str
    has_ended: bool

    def as_text(self) -> str:
        """One line."""
        end = "ended" if self.has_ended else "until"
        return f"{self.name}: {self.role}, since {self.created}, {end} {self.expires}"


@dataclass(frozen=True, slots=True)
class ListedTokens:
    """All tokens of a file."""

    file: str
    tokens: list[ListedToken]


@dataclass(frozen=True, slots=True)
class RevokedToken:
    """A token that no longer signs anybody in."""

    file: str
    name: str


@click.command(
    epilog="Example: edge-service certs --out certificates --name edge-box --name 192.168.1.5"
)
@click.option("--out", type=PATH, required=True, help="Folder to write to.")
@click.option("--name", "names", multiple=True, help="Host name or address of this machine.")
@click.option(
    "--days",
    type=click.IntRange(1, 3650),
    default=825,
    show_default=True,
    help="Days until they expire.",
)
@HISTORY
@answering
def certs(out: Path, names: tuple[str, ...], days: int, history: Path | None) -> Answer:
    """Create certificates: a local authority, the server, each role on the bus.

    The server's is for the page and the bus.

    An authority that is already in the folder is used again, so nobody has to trust a new one.
    """
    from ..bus.access import PUTS, client_name
    from ..certificates import expiry, make_certificates

    clients = {role: client_name(role) for role in PUTS}
    progress("making keys")
    with noted(history, "make_certificates", " ".join((str(out), *names))):
        made = make_certificates(out, names, clients, days)
    until = {str(path): _day(expiry(path)) for path in made}
    lines = [f"{path}: until {day}" for path, day in until.items()]
    authority = out / "ca.pem"
    lines.append(f"browsers and clients must trust {authority}; keep {out / 'ca.key'} elsewhere")
    return Answer("\n".join(lines), Certificates(until=until, authority=str(authority)))


@click.command(epilog="Example: edge-service audit /var/lib/edge-service")
@click.argument("folder", type=PATH)
def audit(folder: Path) -> None:
    """Print the audit log of a history folder as JSON lines, and verify its chain.

    Ends with status 1 if entries are damaged or missing. The service may be running.
    """
    from ..health.events.audit import described, read_audit
    from ..nodes.stores.diary_store import DIARY

    try:
        records = read_audit(folder / DIARY)
    except ValueError as error:
        raise InputError(str(error)) from None
    for record in records:
        click.echo(described(record))
    wrong = [record.number for record in records if record.problem]
    if wrong:
        numbers = ", ".join(map(str, wrong[:10]))
        click.echo(f"{folder / DIARY}: {len(wrong)} entries cannot be trusted: {numbers}", err=True)
        raise click.exceptions.Exit(INTERNAL_FAILURE)


TOKENS = click.option(
    "--file", "path", type=PATH, default=Path("tokens.json"), show_default=True, help="Token file."
)


@click.group(epilog="Example: edge-service token add kim --role operator --file tokens.json")
def token() -> None:
    """Create, list and revoke the tokens with which people and programs sign in."""


@token.command("add", epilog="Example: edge-service token add prometheus --role viewer")
@click.argument("name")
@click.option(
    "--role",
    type=click.Choice(["viewer", "operator", "admin"]),
    required=True,
    help="What it may do.",
)
@click.option(
    "--days",
    type=click.IntRange(1, 3650),
    default=365,
    show_default=True,
    help="Days until it expires.",
)
@TOKENS
@HISTORY
@answering
def add(name: str, role: "RoleName", days: int, path: Path, history: Path | None) -> Answer:
    """Create a token, print it once, and store its hash. A running service accepts it at once."""
    from ..http_api.security.tokens import add_token

    with noted(history, "add_token", f"{name}, {role}, {days} days, {path}"):
        secret = add_token(path, name, role, days, datetime.now(UTC))
    click.echo(f"{path}: {name} is {role}; the token is shown only now", err=True)
    return Answer(secret, AddedToken(file=str(path), name=name, role=role, token=secret))


@token.command("list", epilog="Example: edge-service token list --file tokens.json")
@TOKENS
@answering
def list_tokens(path: Path) -> Answer:
    """List the tokens with their roles and expiry dates."""
    from ..http_api.security.tokens import read_tokens

    now = datetime.now(UTC)
    listed = [
        ListedToken(
            name=each.name,
            role=each.role,
            created=_day(each.created),
            expires=_day(each.expires),
            has_ended=each.expires <= now,
        )
        for each in read_tokens(path)
    ]
    lines = [each.as_text() for each in listed]
    return Answer("\n".join(lines), ListedTokens(file=str(path), tokens=listed))


@token.command("revoke", epilog="Example: edge-service token revoke kim --file tokens.json")
@click.argument("name")
@TOKENS
@HISTORY
@answering
def revoke(name: str, path: Path, history: Path | None) -> Answer:
    """Revoke a token and end its sessions at once."""
    from ..http_api.security.tokens import revoke_token

    with noted(history, "revoke_token", f"{name}, {path}"):
        revoke_token(path, name)
    return Answer(f"{path}: {name} is revoked", RevokedToken(file=str(path), name=name))


def _day(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%d")
