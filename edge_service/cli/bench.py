"""Command that measures the project itself; what it runs stands in a checkout alone."""

import pkgutil
import sys
import tomllib
from pathlib import Path

import click

from .options import InputError

CHECKOUT = Path(__file__).parents[2]
_NONE = "it needs a checkout of the project, and this is an installed package"


@click.command(
    "bench",
    context_settings={"ignore_unknown_options": True},
    add_help_option=False,
    epilog="Example: edge-service bench estimator --quick --only life",
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def bench(arguments: tuple[str, ...]) -> object:
    """Measure speed, memory and accuracy (in a checkout)."""
    return benchmarks(CHECKOUT).main(
        list(arguments), prog_name="edge-service bench", standalone_mode=False
    )


def benchmarks(checkout: Path) -> click.Command:
    """Commands that the project file of a checkout names; `InputError` where it names none."""
    try:
        project = tomllib.loads((checkout / "pyproject.toml").read_text("utf-8"))
        named = str(project["tool"]["edge-service"]["benchmarks"])
    except (OSError, KeyError):
        raise InputError(f"bench: {_NONE}") from None
    if str(checkout) not in sys.path:
        sys.path.insert(0, str(checkout))
    found = pkgutil.resolve_name(named)
    assert isinstance(found, click.Command)
    return found
