"""`edge-service init`: a first configuration, written whole, checked before it takes its place."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...atomic import made_folder, replaced_file
from ...command_answer import Answer
from ...config import ConfigError, load_config, load_machine
from ...exit_status import DONE, INTERNAL_FAILURE
from ..document import Document
from .source import Source
from .text import FirstSheet, Place, configuration_text, machine_text

MACHINE = "machine.toml"
NOT_RIGHT = INTERNAL_FAILURE
"""Exit status: written, and the device does not fit it yet."""
Adopt = Callable[[Path], str]
"""Writes the machine file of recordings; returns what was understood."""
Check = Callable[[Path], Sequence[str]]
"""Lines on what a configuration means. Raises ConfigError."""


@dataclass(frozen=True, slots=True)
class Request:
    """Files to be written, and where.

    Attributes:
        machine: a machine file that is there; None if one is written beside the configuration.
        sheet: what stands in the one that is written for a device.
        force: overwrite what is there.
    """

    source: Source
    place: Place
    out: Path
    machine: Path | None = None
    sheet: FirstSheet = field(default_factory=FirstSheet)
    force: bool = False


class FirstConfiguration(Document):
    """Files of a first configuration; where it is not right yet, `found` says why."""

    found: list[str]
    is_right: bool
    written: list[str]
    next_steps: list[str]

    def as_text(self) -> str:
        """Lines for people."""
        written = [f"{path}: written" for path in self.written]
        steps = [f"  {each}" for each in self.next_steps]
        return "\n".join([*self.found, *written, "next:", *steps])


def init(request: Request, adopt: Adopt, check: Check) -> Answer:
    """Write configuration and machine file; returns what to do next.

    Raises:
        ConfigError, TraceError: one line; then nothing was written.
    """
    wanted = [request.out] if request.machine else [request.out.parent / MACHINE, request.out]
    _may_be_written(wanted, request)
    try:
        made_folder(request.out.parent)
        with tempfile.TemporaryDirectory(prefix=".init-", dir=request.out.parent) as folder:
            lines, status = _drafted(request, Path(folder), adopt, check)
            for path in wanted:
                _take_place(Path(folder) / path.name, path)
    except OSError as error:
        raise ConfigError(f"{request.out}: cannot be written ({error.strerror})") from None
    first = FirstConfiguration(
        found=lines,
        is_right=status == DONE,
        written=list(map(str, wanted)),
        next_steps=list(_next_steps(request, status)),
    )
    return Answer(first.as_text(), first, status)


def _may_be_written(wanted: Sequence[Path], request: Request) -> None:
    if request.out.name == MACHINE:
        raise ConfigError(f"--out {request.out}: is the name of the machine file; choose another")
    taken = [path for path in wanted if path.exists()]
    if any(path in request.source.recordings for path in map(Path.resolve, wanted)):
        raise ConfigError(f"--out {request.out}: would overwrite a recording")
    if taken and not request.force:
        raise ConfigError(f"{taken[0]}: is there already; --force overwrites it")


def _drafted(request: Request, folder: Path, adopt: Adopt, check: Check) -> tuple[list[str], int]:
    """Both files, in a folder where nobody looks for them."""
    said = [] if request.machine else _drafted_machine(request, folder / MACHINE, adopt)
    machine = str(request.machine.resolve()) if request.machine else MACHINE
    draft = folder / request.out.name
    draft.write_text(configuration_text(request.source, request.place, machine), "utf-8")
    shown = "" if request.out.parent == Path() else f"{request.out.parent}/"
    try:
        for axis in load_config(draft).axes:
            load_machine(axis.machine)
    except ConfigError as error:
        raise ConfigError(str(error).replace(f"{folder}/", shown)) from None
    try:
        return [*said, *(line.replace(f"{folder}/", shown) for line in check(draft))], DONE
    except ConfigError as error:
        return [*said, f"not right yet: {error}".replace(f"{folder}/", shown)], NOT_RIGHT


def _drafted_machine(request: Request, draft: Path, adopt: Adopt) -> list[str]:
    """The machine file; returns what was understood of recordings."""
    if request.source.recordings:
        return [line for line in adopt(draft).splitlines() if not line.startswith(str(draft))]
    draft.write_text(machine_text(request.place.axis, request.sheet), "utf-8")
    return []


def _take_place(draft: Path, path: Path) -> None:
    with replaced_file(path) as file:
        file.write(draft.read_text("utf-8"))


def _next_steps(request: Request, status: int) -> Iterator[str]:
    out, recordings = request.out, request.source.recordings
    machine = request.machine or out.parent / MACHINE
    if status != DONE:
        yield f"mend the signals in {out}, then: edge-service check-config {out}"
    elif recordings:
        names = " ".join(map(str, recordings))
        yield f"edge-service commission {names} --machine {machine} --out commissioned.toml"
        yield "  (of the healthy, cold axis; then name that file in the configuration)"
    else:
        yield f"compare the signals in {out} with your machine's, then, while the axis moves:"
        yield f"edge-service doctor --config {out}"
    yield f"edge-service run {out}    # the page: http://127.0.0.1:8080/"
