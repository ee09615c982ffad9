"""The command that writes motions for a controller."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from .options import MACHINE, PATH, InputError, answering, out_option
from .terminal import progress

if TYPE_CHECKING:
    from ..offline.motion.motion_file import MotionFileSettings


@click.command(epilog="Example: edge-service motion next out/diagnosis.json --out setpoints.csv")
@click.argument("name", required=False)
@click.argument("files", nargs=-1, type=PATH)
@MACHINE
@click.option(
    "--list", "list_all", is_flag=True, help="List every motion; --out FILE.png draws them."
)
@click.option("--duration", "duration_s", type=float, help="Length of the whole motion, s.")
@click.option(
    "--rate", "rate_hz", default=1000.0, show_default=True, help="Setpoints written per second."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Seed of motions with random moves.",
)
@click.option(
    "--clip", is_flag=True, help="Leave out moves beyond the limits of the axis, and list them."
)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    help="With `next`: an effect to distinguish; repeat it for each.",
)
@click.option("--motion", "rehearsed", help="With `isolability`: the motion to examine.")
@out_option("File to write: setpoints as .csv or an NC program as .mpf.", required=False)
@answering
def motion(
    name: str | None,
    files: tuple[Path, ...],
    machine: Path,
    list_all: bool,
    duration_s: float | None,
    rate_hz: float,
    seed: int,
    clip: bool,
    effects: tuple[str, ...],
    rehearsed: str | None,
    out: Path | None,
) -> Answer:
    """Write a motion for a controller: setpoints as CSV, or an NC program.

    `motion next DIAGNOSIS.json` proposes the shortest motion that separates the causes between
    which a diagnosis could not decide, with the evidence to expect. `motion isolability TRACE`, or
    with --motion NAME, shows what a motion can distinguish, before anything is measured.

    A motion beyond stroke, speed, acceleration or torque of the machine file is refused.
    """
    from ..config import load_machine
    from ..offline.motion.motion_file import MotionFileSettings, write_motion

    if list_all:
        return _list(machine, out)
    settings = MotionFileSettings(duration_s, rate_hz, seed, clip)
    if name == "next":
        return _proposed(machine, files, effects, out, settings)
    if name == "isolability":
        from ..offline.motion.isolability import isolability

        return isolability(load_machine(machine), rehearsed, files, progress)
    if files:
        raise InputError(f"motion: {files[0]}: {name} takes no file")
    if name is None or out is None:
        raise InputError("motion: expected a NAME and --out, or --list")
    written = write_motion(name, load_machine(machine), out, settings, progress)
    return Answer(written.as_text(), written)


def _list(machine: Path, out: Path | None) -> Answer:
    from ..config import load_machine
    from ..offline.motion.motion_file import ListedMotions, list_motions
    from ..offline.motion.picture import write_motions_picture

    axis = load_machine(machine)
    listed = list_motions(axis)
    lines = [each.as_text() for each in listed]
    if out is not None:
        progress("drawing")
        lines.append(write_motions_picture(axis, out))
    return Answer("\n".join(lines), ListedMotions(motions=listed, picture=out and str(out)))


def _proposed(
    machine: Path,
    files: tuple[Path, ...],
    effects: tuple[str, ...],
    out: Path | None,
    settings: "MotionFileSettings",
) -> Answer:
    """The motion that tells tied effects apart."""
    from ..config import load_machine
    from ..offline.motion.next_motion import next_motion, tied_effects, typical

    if len(files) + bool(effects) != 1:
        raise InputError("motion next: expected one DIAGNOSIS.json, or --effect twice or more")
    tied = tied_effects(files[0]) if files else typical(effects)
    return next_motion(load_machine(machine), tied, out, settings, progress)
