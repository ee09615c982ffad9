"""Command that proposes a machine file from recordings."""

from pathlib import Path

import click

from ..command_answer import Answer
from .options import (
    AXIS_NUMBER,
    LEAD,
    LOAD_RATING,
    PATH,
    POSITIVE,
    PRELOAD,
    PRELOAD_DRAG,
    answering,
    out_option,
)
from .terminal import ask_number, at_terminal, progress


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
    help="Torque constant of the motor, N m per A, or per unit of the torque column.",
)
@click.option("--period", type=POSITIVE, help="Sampling period, s, if no column holds the time.")
@LOAD_RATING
@PRELOAD
@PRELOAD_DRAG
@click.option("--nut-stiffness", type=POSITIVE, help="Stiffness of the nut, N/m.")
@click.option("--table-mass", type=POSITIVE, help="Moved mass, kg: the table and everything on it.")
@click.option(
    "--column",
    "columns",
    multiple=True,
    metavar="QUANTITY=COLUMN[:UNIT]",
    help="What a column contains, e.g. current=#6:mA; repeat it for several.",
)
@click.option(
    "--picture", type=PATH, help="Also draw the channels as understood, to this PNG file."
)
@answering
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
) -> Answer:
    """Propose a machine file from recordings of an axis, with a reason for every line.

    At a terminal it asks for what recordings cannot show; Enter leaves a question open.
    """
    from ..checks.columns.guess import Known
    from ..offline.adopt.adopt import Request
    from ..offline.adopt.adopt import adopt as run
    from ..offline.adopt.machine_text import DataSheet

    known = Known(None if lead is None else 1e-3 * lead, torque_constant, period)
    sheet = DataSheet(
        name or "X", None, load_rating, preload, preload_drag, nut_stiffness, table_mass
    )
    request = Request(files, out, axis_number, known, sheet, columns, picture)
    return run(request, ask_number if at_terminal() else None, progress)
