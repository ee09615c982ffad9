"""Commands that roll out configurations to the machines of a site."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import click

from ...command_answer import Answer
from ..audited import noted
from ..options import PATH, answering, out_option
from ..terminal import progress

TRUST = click.option(
    "--trust", type=PATH, required=True, help="Public key of whoever may sign bundles."
)
BUNDLE = click.argument("bundle", type=PATH)
CONFIG = click.argument("config", type=PATH)


@click.group(
    epilog="Example: edge-service rollout apply site.bundle --trust site.pem --machine mill-1"
    " edge.toml --dry-run"
)
def rollout() -> None:
    """Roll out signed configurations to the machines of a site."""


@rollout.command("key", epilog="Example: edge-service rollout key site.key")
@click.argument("file", type=PATH)
@answering
def key(file: Path) -> Answer:
    """Make the pair of keys that signs bundles and that machines trust."""
    from ...offline.rollout.keys import make_keys

    return make_keys(file)


@rollout.command(
    "pack",
    epilog="Example: edge-service rollout pack mill-1/edge.toml mill-2/edge.toml"
    " --key site.key --out site.bundle",
)
@click.argument("configs", nargs=-1, required=True, type=PATH)
@click.option("--key", "key_file", type=PATH, required=True, help="Private key that signs.")
@out_option("File to write. If it is a bundle, its number is the one before.")
@click.option(
    "--number",
    type=click.IntRange(1, 2**53),
    show_default="one more than the bundle that --out replaces, else 1",
    help="Number of the bundle; machines take none that is not above all before.",
)
@click.option(
    "--time",
    "made",
    type=click.DateTime(["%Y-%m-%dT%H:%M:%S%z", "%Y-%m-%dT%H:%M:%S.%f%z"]),
    show_default="now",
    help="Time to state, e.g. 2026-01-31T12:00:00+00:00.",
)
@click.option(
    "--for",
    "versions",
    multiple=True,
    metavar="VERSION",
    show_default="this one",
    help="Minor version of edge-service that it is for, e.g. 0.1; repeat for more.",
)
@click.option("--fleet", metavar="NAME", help="Fleet file beside the configurations to pack too.")
@answering
def pack(
    configs: tuple[Path, ...],
    key_file: Path,
    out: Path,
    number: int | None,
    made: datetime | None,
    versions: tuple[str, ...],
    fleet: str | None,
) -> Answer:
    """Pack configurations of the machines of one site, with their machine files, and sign them.

    Secrets, certificates and what a service writes stay on the machines.
    """
    from ...offline.rollout import pack as packing

    progress("checking configurations")
    if number is None:
        number = packing.next_number(out, key_file)
    return packing.pack(
        configs, key_file, out, number=number, made=made, versions=versions, fleet=fleet
    )


@rollout.command("show", epilog="Example: edge-service rollout show site.bundle --trust site.pem")
@BUNDLE
@TRUST
@answering
def show(bundle: Path, trust: Path) -> Answer:
    """Check the signature of a bundle and list what it holds."""
    from ...offline.rollout import bundle as bundles

    return bundles.show(bundle, trust)


@rollout.command(
    "apply",
    epilog="Example: edge-service rollout apply site.bundle --trust site.pem --machine mill-1"
    " edge.toml --dry-run",
)
@BUNDLE
@CONFIG
@TRUST
@click.option("--machine", required=True, help="Name of this machine in the bundle.")
@click.option("--dry-run", is_flag=True, help="Print what changes, and write nothing.")
@answering
def apply(bundle: Path, config: Path, trust: Path, machine: str, dry_run: bool) -> Answer:
    """Put a bundle in place on this machine, whole or not at all, and print what changes.

    It is checked before as `check-config` does. The service reads it when it is restarted.
    """
    from ...offline.rollout import apply as rollouts

    progress("checking the bundle")
    if dry_run:
        return rollouts.apply(bundle, trust, machine, config, dry_run=True)
    with _noted(config, "apply_rollout", f"{bundle}, {machine}"):
        return rollouts.apply(bundle, trust, machine, config, dry_run=False)


@rollout.command("back", epilog="Example: edge-service rollout back edge.toml")
@CONFIG
@click.option(
    "--force", is_flag=True, help="Even if files were changed here, or the service refuses them."
)
@answering
def back(config: Path, force: bool) -> Answer:
    """Put back what was there before the last bundle."""
    from ...offline.rollout import apply as rollouts

    with _noted(config, "take_back_rollout", str(config)):
        return rollouts.back(config, force=force)


@rollout.command("status", epilog="Example: edge-service rollout status edge.toml")
@CONFIG
@answering
def status(config: Path) -> Answer:
    """Print the versions of program, configuration and bundle, and what was changed here."""
    from ...offline.rollout import status as rollouts

    return rollouts.status(config)


@contextmanager
def _noted(config: Path, action: str, target: str) -> Iterator[None]:
    """Note the change in the audit log of the service, if it has one by now."""
    from ...config import ConfigError, load_config
    from ...nodes.stores.diary_store import DIARY

    try:
        folder = load_config(config).history.folder
    except ConfigError:  # there is none yet, or it is what the bundle mends
        folder = None
    if folder is None or not (folder / DIARY).is_file():
        yield
        return
    with noted(folder, action, target):
        yield
