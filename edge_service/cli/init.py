"""Command that writes a first configuration."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from .options import LEAD, LOAD_RATING, PATH, POSITIVE, PRELOAD, PRELOAD_DRAG, InputError, answering
from .terminal import ask_number, at_terminal, progress

if TYPE_CHECKING:
    from ..offline.init.text import FirstSheet


@click.command(
    epilog="Example: edge-service init opc.tcp://192.168.0.5:4840 --lead 10 --inertia 1.5e-3"
)
@click.argument("sources", nargs=-1, metavar="[SOURCE]...")
@click.option(
    "--out", type=PATH, default="edge.toml", show_default=True, help="Configuration to write."
)
@click.option("--machine", type=PATH, help="Machine file of the axis; else one is written.")
@LEAD
@click.option("--inertia", type=POSITIVE, help="All that turns and moves, at the motor, kg m^2.")
@LOAD_RATING
@PRELOAD
@PRELOAD_DRAG
@click.option(
    "--torque-constant", type=click.FloatRange(), help="Of recordings: torque per A, N m."
)
@click.option("--axis", default="X", show_default=True, help="Name of the axis.")
@click.option("--site", default="shop", show_default=True, help="Name of the shop or hall.")
@click.option("--name", default="machine", show_default=True, help="Name of the machine.")
@click.option(
    "--history",
    type=PATH,
    default="history",
    show_default=True,
    help="Folder of the history, seen from that of the configuration.",
)
@click.option("--force", is_flag=True, help="Overwrite what is there.")
@answering
def init(
    sources: tuple[str, ...],
    out: Path,
    machine: Path | None,
    lead: float | None,
    inertia: float | None,
    load_rating: float | None,
    preload: float | None,
    preload_drag: float | None,
    torque_constant: float | None,
    axis: str,
    site: str,
    name: str,
    history: Path,
    force: bool,
) -> Answer:
    """Write and check a first configuration, and say what to do next.

    SOURCE is the device (modbus://HOST:PORT, opc.tcp://HOST:PORT, mqtt://HOST:PORT/TOPIC, or a
    HOST, which is asked what it is) or recordings of the axis, which `adopt` then reads. Without
    SOURCE this computer is searched. At a terminal it asks for what is missing.
    """
    from ..checks.columns.guess import Known
    from ..offline.adopt.adopt import Request as Recordings
    from ..offline.adopt.adopt import adopt as run_adopt
    from ..offline.adopt.machine_text import DataSheet
    from ..offline.configuration import check_configuration
    from ..offline.init.init import Request
    from ..offline.init.init import init as run
    from ..offline.init.source import source_of
    from ..offline.init.text import FirstSheet, Place

    progress("looking for the source")
    source = source_of(sources or (_found_source(),))
    lead_m = None if lead is None else 1e-3 * lead
    sheet = FirstSheet(lead_m, load_rating, inertia, preload, preload_drag)
    if machine is None and not source.recordings:
        sheet = _with_answers(sheet)
    request = Request(source, Place(site, name, axis, history), out, machine, sheet, force)
    ask = ask_number if at_terminal() else None

    def adopted(path: Path) -> str:
        known = Known(lead_m, torque_constant)
        data = DataSheet(axis, None, load_rating, preload, preload_drag)
        return run_adopt(
            Recordings(source.recordings, path, None, known, data), ask, progress
        ).words

    return run(request, adopted, lambda path: check_configuration(path).words.splitlines())


def _found_source() -> str:
    """A device of this computer, or what a person says instead. Raises InputError."""
    from ..offline.init.source import EXPECTED, devices_here

    found = devices_here()
    if at_terminal():
        click.echo(f"devices on this computer: {', '.join(found) or 'none'}")
        said: str = click.prompt("Device or recording", default=found[0] if found else None)
        return said
    if len(found) != 1:
        several = f"{len(found)} devices on this computer ({', '.join(found)})"
        raise InputError(
            f"SOURCE: {several if found else 'no device on this computer'}; {EXPECTED}"
        )
    return found[0]


def _with_answers(sheet: "FirstSheet") -> "FirstSheet":
    """The data sheet with what a person knows of it. Raises InputError where it is too little."""
    from ..offline.init.text import SHEET_QUESTIONS

    for key, (question, unit) in SHEET_QUESTIONS.items():
        if getattr(sheet, key) is None and at_terminal():
            said = ask_number(question)
            sheet = replace(sheet, **{key: None if said is None else unit * said})
    if sheet.lead_m is None or sheet.inertia_kg_m2 is None:
        raise InputError("--machine: missing; or give at least --lead and --inertia")
    return sheet
