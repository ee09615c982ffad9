"""Command that proposes a machine file from recordings."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .options import AXIS_NUMBER, PATH, out_option

if TYPE_CHECKING:
    from ..adopt.guess import Question

_POSITIVE = click.FloatRange(min=0.0, min_open=True)


@click.command(
    epilog="Example: edge-service adopt move1.csv move2.csv --lead 10 --out machine.toml"
)
@click.argument("files", nargs=-1, required=True, type=PATH)
@out_option("Machine file to write.")
@AXIS_NUMBER
@click.option("--name", help="Name of the axis.  [default: as the file spells it, or X]")
@click.option("--lead", type=_POSITIVE, help="Travel per revolution of the motor, mm.")
@click.option(
    "--torque-constant",
    type=click.FloatRange(),
    help="Torque of the motor per A, or per unit of the column that tells it, N m.",
)
@click.option(
    "--period", type=_POSITIVE, help="Length of a sample, s, if no column holds the time."
)
@click.option("--load-rating", type=_POSITIVE, help="Dynamic load rating of the screw, N.")
@click.option("--preload", type=_POSITIVE, help="Preload of the fresh screw, N.")
@click.option("--preload-drag", type=_POSITIVE, help="Drag torque of the fresh screw alone, N m.")
@click.option("--nut-stiffness", type=_POSITIVE, help="Stiffness of the nut, N/m.")
@click.option("--table-mass", type=_POSITIVE, help="Mass of the table with what is on it, kg.")
@click.option(
    "--column",
    "columns",
    multiple=True,
    metavar="QUANTITY=COLUMN[:UNIT]",
    help="What a column is, e.g. current=#6:mA; may be repeated.",
)
@click.option("--picture", type=PATH, help="Also draw the channels as understood, as PNG file.")
def adopt(
    files: tuple[Path, ...],
    out: Path,
    axis_number: int | None,
    name: str | None,
    lead: float | None,
    torque_constant: float | None,
    period: float | None,
    load_rating: float | None,
    preload: float | None,
    preload_drag: float | None,
    nut_stiffness: float | None,
    table_mass: float | None,
    columns: tuple[str, ...],
    picture: Path | None,
) -> None:
    """Propose the machine file of an axis from recordings, each line with its reason.

    At a terminal it asks for what no recording tells; an empty answer leaves it open.
    """
    from ..adopt.guess import Known
    from ..offline.adopt.adopt import Request
    from ..offline.adopt.adopt import adopt as run
    from ..offline.adopt.machine_text import DataSheet

    known = Known(None if lead is None else 1e-3 * lead, torque_constant, period)
    sheet = DataSheet(
        name or "X", None, load_rating, preload, preload_drag, nut_stiffness, table_mass
    )
    request = Request(files, out, axis_number, known, sheet, columns, picture)
    at_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    click.echo(run(request, _ask if at_terminal else None))


def _ask(question: "Question") -> float | None:
    """Ask a person; an empty answer is none."""
    while True:
        said: str = click.prompt(
            f"{question.words} (for: {question.why}; empty if unknown)",
            default="",
            show_default=False,
        )
        if not said.strip():
            return None
        try:
            return float(said.replace(",", "."))
        except ValueError:
            click.echo("expected a number")
