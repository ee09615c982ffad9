"""Command about the tokens that let people and programs in."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from .options import PATH, InputError, answering

if TYPE_CHECKING:
    from ..health.store.tokens import Role


@dataclass(frozen=True, slots=True)
class AddedToken:
    """The only place where the token itself is shown."""

    name: str
    role: str
    token: str


@dataclass(frozen=True, slots=True)
class ListedToken:
    """One token; times in UTC, `used_at` to some ten minutes."""

    name: str
    role: str
    created_at: str
    used_at: str | None

    def as_text(self) -> str:
        """One line."""
        return f"{self.name}: {self.role}, since {self.created_at}, used {self.used_at or 'never'}"


@dataclass(frozen=True, slots=True)
class ListedTokens:
    """All tokens of a service."""

    items: list[ListedToken]


@dataclass(frozen=True, slots=True)
class RevokedToken:
    """A token that lets nobody in any more."""

    name: str


@click.command(epilog="Example: edge-service token edge.toml --add kim --role operator")
@click.argument("config", type=PATH)
@click.option("--add", "added", metavar="NAME", help="Name of a token to create.")
@click.option("--role", type=click.Choice(["viewer", "operator"]), help="Role of the new token.")
@click.option("--revoke", "revoked", metavar="NAME", help="Name of a token to revoke.")
@answering
def token(config: Path, added: str | None, role: "Role | None", revoked: str | None) -> Answer:
    """Create, list or revoke the tokens that let people in.

    A viewer reads; an operator may do everything. A running service knows within a second.
    """
    from ..clock import now_ns
    from ..config import load_config
    from ..health.store.store import StoreFailedError
    from ..nodes.wiring.http_rights import tokens_of

    if (added is None) != (role is None) or (added and revoked):
        raise InputError("expected --add NAME --role viewer|operator, or --revoke NAME, or neither")
    settings = load_config(config)
    if settings.store.folder is None:
        raise InputError(f"{config}: store.folder: missing; tokens are kept in the state folder")
    tokens = tokens_of(settings)
    try:
        if added is not None and role is not None:
            secret = tokens.add(added, role, now_ns())
            click.echo(f"{added} is {role}; the token is shown only now", err=True)
            return Answer(secret, AddedToken(name=added, role=role, token=secret))
        if revoked is not None:
            tokens.revoke(revoked)
            return Answer(f"{revoked} is revoked", RevokedToken(name=revoked))
        listed = [
            ListedToken(
                name=each.name,
                role=each.role,
                created_at=_written(each.created_ns),
                used_at=None if each.used_ns is None else _written(each.used_ns),
            )
            for each in tokens.all()
        ]
    except StoreFailedError as error:
        raise InputError(str(error)) from None
    lines = [each.as_text() for each in listed] or ["no tokens: any user of this machine may look"]
    return Answer("\n".join(lines), ListedTokens(items=listed))


def _written(time_ns: int) -> str:
    moment = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
    return moment.isoformat().replace("+00:00", "Z")
