"""`edge-service init`: a first configuration, written whole, checked before it takes its place."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import tomlkit
from tomlkit.items import AoT

from ..atomic import made_folder, write_whole
from ..checks.columns.guess import Known
from ..command_answer import Answer
from ..config import DEFAULT_CONFIG, ConfigError, load_config, load_machine
from ..exit_status import DONE, INTERNAL_FAILURE
from .adopt import adopt
from .configuration import check_configuration
from .machine_text import Ask, Sheet, asked, stated_text

EXAMPLES = DEFAULT_CONFIG.parent / "drivers"
EXPECTED = "expected a recording, or modbus://, opc.tcp:// or mqtt:// with host and port"
MACHINE = "machine.toml"
NEEDED = ("axis.lead_m", "model.inertia_kg_m2")
"""Keys without which a machine file is none."""
ASKED = ("lead_m", "inertia_kg_m2", "dynamic_load_rating_n", "preload_n", "preload_drag_nm")
_PORTS = {"modbus": 502, "mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class DeviceSource:
    """A driver with those of its settings that the address tells; a recording where it is one."""

    driver: str
    settings: dict[str, str | int]
    recording: Path | None = None


@dataclass(frozen=True, slots=True)
class Request:
    """Files to be written, and where."""

    source: DeviceSource
    out: Path
    # a machine file that is there; None if one is written beside the configuration
    machine: Path | None = None
    axis: str = "X"
    sheet: Sheet = field(default_factory=dict)  # what stands in the one that is written
    force: bool = False  # overwrite what is there


def init(request: Request, ask: Ask | None = None) -> Answer:
    """Write configuration and machine file; returns what to do next.

    Raises ConfigError, TraceError: one line; then nothing was written.
    """
    out, recording = request.out, request.source.recording
    wanted = [out] if request.machine else [out.parent / MACHINE, out]
    if out.name == MACHINE:
        raise ConfigError(f"--out {out}: is the name of the machine file; choose another")
    if recording is not None and recording in [path.resolve() for path in wanted]:
        raise ConfigError(f"--out {out}: would overwrite a recording")
    taken = [path for path in wanted if path.exists()]
    if taken and not request.force:
        raise ConfigError(f"{taken[0]}: is there already; --force overwrites it")
    try:
        made_folder(out.parent)
        with tempfile.TemporaryDirectory(prefix=".init-", dir=out.parent) as folder:
            lines, status, is_right = _drafted(request, Path(folder), ask)
            for path in wanted:
                write_whole(path, (Path(folder) / path.name).read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written ({error.strerror})") from None
    steps = list(_next_steps(request, status))
    document = {"found": lines, "is_right": is_right}
    document |= {"written": list(map(str, wanted)), "next_steps": steps}
    words = [*lines, *(f"{path}: written" for path in wanted), "next:"]
    return Answer("\n".join([*words, *(f"  {each}" for each in steps)]), document, status)


def _drafted(request: Request, folder: Path, ask: Ask | None) -> tuple[list[str], int, bool]:
    """Both files, in a folder where nobody looks for them.

    Returns:
        What was found, the status, and whether all is there and the source has answered.
    """
    said: list[str] = []
    draft, machine = folder / request.out.name, folder / MACHINE
    if request.machine is None and request.source.recording is not None:
        lead_m = request.sheet.get("lead_m")
        known = Known(None if lead_m is None else float(lead_m))
        given = (request.source.recording,), machine, None, known, request.axis, request.sheet
        lines = adopt(*given, ask=ask).words.splitlines()
        said = [line for line in lines if not line.startswith(str(machine))]
    elif request.machine is None:
        write_whole(machine, stated_text(request.axis, asked(request.sheet, ASKED, ask)))
    named = str(request.machine.resolve()) if request.machine else MACHINE
    head = tomlkit.document()
    head["service"] = {"site": "shop", "machine": "machine"}
    head["store"] = {"folder": "history"}
    example = tomlkit.parse((EXAMPLES / f"{request.source.driver}.toml").read_text("utf-8"))
    axes = example["axes"]
    assert isinstance(axes, AoT)
    axes[0].update({"name": request.axis, "machine": named})
    axes[0]["settings"].update(request.source.settings)
    write_whole(draft, f"{tomlkit.dumps(head)}\n{tomlkit.dumps(example)}")
    shown = "" if request.out.parent == Path() else f"{request.out.parent}/"
    try:
        for axis in load_config(draft).axes:
            load_machine(axis.machine)
    except ConfigError as error:
        mistakes = [each.replace(f"{folder}/", shown) for each in error.mistakes]
        ends = tuple(f"{key}: missing" for key in NEEDED)
        if request.machine or not all(each.endswith(ends) for each in mistakes):
            raise ConfigError(*mistakes) from None
        left_out = [f"left out: {each}; no estimate without it" for each in mistakes]
        return [*said, *left_out], DONE, False
    try:
        checked = check_configuration(draft)
        found = [line.replace(f"{folder}/", shown) for line in checked.words.splitlines()]
        return [*said, *found], DONE, not checked.document["not_reachable"]
    except ConfigError as error:
        wrong = [each.replace(f"{folder}/", shown) for each in error.mistakes]
        return [*said, *(f"not right yet: {each}" for each in wrong)], INTERNAL_FAILURE, False


def _next_steps(request: Request, status: int) -> Iterator[str]:
    out, recording = request.out, request.source.recording
    machine = request.machine or out.parent / MACHINE
    if status != DONE:
        yield f"mend the signals in {out}, then: edge-service check-config {out}"
    elif recording:
        yield f"edge-service commission {recording} --machine {machine} --out commissioned.toml"
        yield "  (of the healthy, cold axis; then name that file in the configuration)"
    else:
        yield f"compare the signals in {out} with your machine's, then, while the axis moves:"
        yield f"edge-service doctor {out}"
    yield f"edge-service run {out}    # the page: http://127.0.0.1:8080/"


def source_of(given: str) -> DeviceSource:
    """The source that a person names. Raises ConfigError."""
    if Path(given).is_file():
        path = Path(given).resolve()
        return DeviceSource("replay", {"path": str(path)}, path)
    try:
        parts = urlsplit(given)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or port == 0 or parts.scheme not in (*_PORTS, "opc.tcp"):
        raise ConfigError(f"{given}: {EXPECTED}")
    if parts.scheme == "opc.tcp":
        return DeviceSource("opcua", {"url": given})
    url, rest = f"{parts.scheme}://{parts.netloc}", parts.path.strip("/")
    if port is None:
        url += f":{_PORTS[parts.scheme]}"
    if parts.scheme == "modbus":
        return DeviceSource("modbus", {"url": f"{url}/{rest or 1}"})
    return DeviceSource("mqtt", {"url": url, "topic": rest} if rest else {"url": url})
