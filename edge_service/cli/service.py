"""Commands that run the service, check and copy what it keeps, and look at many of them."""

import asyncio
import gc
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import click

from ..command_answer import Answer
from ..exit_status import BadInputError
from .options import Endpoint, Option, Port, command, configured
from .terminal import announce, log_to_stderr, progress, wants_json


@command("run deploy/edge.toml --port 8080", answers=False)
def run(config: Path | None, port: Port, endpoint: Endpoint) -> None:
    """Run the whole service, or the demo if no CONFIG is given."""
    click.echo("edge-service: starting", err=True)
    _serve(config, port, endpoint)


@command("node bus edge.toml & edge-service node http edge.toml", answers=False)
def node(name: str, config: Path | None, port: Port, endpoint: Endpoint) -> None:
    """Run one node of the service in a process of its own.

    NAME is bus (the router that all others connect to), acquire, downsample, estimate, health, http
    or an output.
    """
    _serve(config, port, endpoint, name)


def _serve(config: Path | None, port: Port, endpoint: Endpoint, name: str | None = None) -> None:
    gc.disable()  # what is imported stays: looking through it takes a tenth of the start
    from ..nodes.service import run_service

    gc.freeze()
    gc.enable()
    log_to_stderr()
    asyncio.run(run_service(partial(configured, config, port, endpoint), announce, name))


@command("check-config deploy/edge.toml", "check-config")
def check_config(config: Path | None) -> Answer:
    """Check a configuration and every file that it names.

    Each mistake is a line of its own; with --json a right configuration shows every key with its
    value, secrets as ***.
    """
    from ..config import DEFAULT_CONFIG
    from ..offline.configuration import check_configuration

    progress("checking configuration and sources")
    checked = check_configuration(config or DEFAULT_CONFIG)
    return replace(checked, words=f"{checked.words}\nconfiguration is right")


@command("token edge.toml --add kim --role operator")
def token(
    config: Path,
    added: Annotated[str | None, Option("Token to create.", "--add", metavar="NAME")],
    role: Annotated[Literal["viewer", "operator"] | None, Option("Role of the new token.")],
    revoked: Annotated[str | None, Option("Token to revoke.", "--revoke", metavar="NAME")],
) -> Answer:
    """Create, list or revoke the tokens that let people in.

    A viewer reads; an operator may do everything. A running service knows within a second.
    """
    if (added is None) != (role is None) or (added and revoked):
        raise BadInputError("expected --add NAME --role viewer|operator, --revoke NAME, or neither")
    from ..clock import now_ns
    from ..config import load_config
    from ..health.store.store import StoreFailedError
    from ..nodes.http_rights import tokens_of

    settings = load_config(config)
    if settings.store.folder is None:
        raise BadInputError(f"{config}: store.folder: missing; tokens are kept in the state folder")
    tokens = tokens_of(settings)
    try:
        if added is not None and role is not None:
            secret = tokens.add(added, role, now_ns())
            click.echo(f"{added} is {role}; the token is shown only now", err=True)
            return Answer(secret, {"name": added, "role": role, "token": secret})
        if revoked is not None:
            tokens.revoke(revoked)
        listed = [each.model_dump(mode="json") for each in tokens.all()]
    except StoreFailedError as error:
        raise BadInputError(str(error)) from None
    words = "{name}: {role}, since {created_at}, used {used_at}"
    lines = [words.format(**each | {"used_at": each["used_at"] or "never"}) for each in listed]
    free = "nobody is let in" if settings.http.needs_token else "any local user may do everything"
    lines = lines or [f"no tokens: {free}"]
    if revoked is not None:
        lines = [f"{revoked} is revoked", *(() if listed else lines)]
    return Answer("\n".join(lines), {"name": revoked} if revoked else {"items": listed})


@command("backup /etc/edge-service/edge.toml --out backup.zip")
def backup(
    config: Path,
    out: Annotated[Path, Option("Archive to write, for its owner alone: it may hold secrets.")],
    recordings: Annotated[bool, Option("Keep the recordings as well.")],
) -> Answer:
    """Copy configuration and history while the service runs."""
    from ..offline.backup import back_up

    progress("copying")
    return back_up(config, out, recordings=recordings)


@command("restore backup.zip /etc/edge-service/edge.toml")
def restore(
    archive: Path,
    config: Path,
    force: Annotated[bool, Option("Replace what differs; it stays beside, as NAME.before-TIME.")],
) -> Answer:
    """Put a backup in place, whole or not at all.

    CONFIG is the configuration to write, with the files that it names beside it; the history goes
    where that configuration keeps it. No service may be running on it.
    """
    from ..offline import backup as backups

    progress("checking the backup")
    return backups.restore(archive, config, force=force)


@command("fleet tcp/router.plant:7447 --watch 10")
def fleet(
    addresses: Annotated[tuple[str, ...], "ADDRESS..."],
    period_s: Annotated[
        float | None, Option("Time between rounds, s.", "--watch", click.FloatRange(1.0))
    ],
) -> Iterator[Answer]:
    """Show the axes of many machines, worst first.

    ADDRESS is that of a service (http://, https://; its token by .netrc) or of a Zenoh router
    (tcp/HOST:PORT, tls/HOST:PORT; certificates by ZENOH_CONFIG).
    """
    from rich.console import Console

    from ..offline.fleet import FleetWatch, table_of

    on_terminal = sys.stdout.isatty() and not wants_json()
    console = Console(highlight=False, width=None if on_terminal else 200)
    try:
        watch = FleetWatch(addresses)
    except ValueError as error:
        raise BadInputError(str(error)) from None
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
