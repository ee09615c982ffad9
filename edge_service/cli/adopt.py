"""Command that proposes a machine file from recordings."""

from pathlib import Path

import click

from .options import (
    AXIS_NUMBER,
    LEAD,
    LOAD_RATING,
    PATH,
    POSITIVE,
    PRELOAD,
    PRELOAD_DRAG,
    out_option,
)
from .terminal import ask_number, at_terminal


@click.command(
    epilog="Example: edge-service adopt move1.csv move2.csv --lead 10 --out machine.toml"
)
@click.argument("files", nargs=-1, required=True, type=PATH)
@out_option("Machine file to write.")
@AXIS_NUMBER
@click.option("--name", help="Name of the axis.  [default: as the file spells it, or X]")
@LEAD
@click.option(
    "--torque-constant",
    type=click.FloatRange(),
    help="Torque of the motor per A, or per unit of the column that tells it, N m.",
)
@click.option("--period", type=POSITIVE, help="Length of a sample, s, if no column holds the time.")
@LOAD_RATING
@PRELOAD
@PRELOAD_DRAG
@click.option("--nut-stiffness", type=POSITIVE, help="Stiffness of the nut, N/m.")
@click.option("--table-mass", type=POSITIVE, help="Mass of the table with what is on it, kg.")
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
    click.echo(run(request, ask_number if at_terminal() else None))
