"""Commands that connect a machine: its configuration, its machine file, what samples come from."""

import asyncio
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click

from ..command_answer import Answer
from ..exit_status import DONE, INTERNAL_FAILURE, BadInputError
from .options import (
    POSITIVE,
    AxisNumber,
    Endpoint,
    Keys,
    Lead,
    MachineFile,
    Option,
    Port,
    Screw,
    Traces,
    command,
    configured,
)
from .terminal import announce, ask_number, at_terminal, log_to_stderr, progress

if TYPE_CHECKING:
    from ..config import EdgeConfig


@command('init opc.tcp://192.168.0.5:4840 --screw "20x10 C18200 P900"')
def init(
    source: str | None,
    machine: Annotated[Path | None, Option("Machine file of the axis; else one is written.")],
    screw: Screw,
    lead: Lead,
    keys: Keys,
    force: Annotated[bool, Option("Overwrite what is there.")],
    axis: Annotated[str, Option("Name of the axis.")] = "X",
    out: Annotated[Path, Option("Configuration to write.")] = Path("edge.toml"),
) -> Answer:
    """Write a first configuration for a device or a recording.

    SOURCE is the device (modbus://HOST:PORT, opc.tcp://HOST:PORT or mqtt://HOST:PORT/TOPIC) or a
    recording of the axis, which `adopt` then reads. At a terminal it asks for what is missing. Ends
    with status 1 if the device does not fit its signals yet.
    """
    from ..offline import init as room
    from ..offline.machine_text import stated

    known = stated(screw, lead, keys)
    if source is None and not at_terminal():
        raise BadInputError(f"SOURCE: {room.EXPECTED}")
    found = room.source_of(source or click.prompt("Device or recording"))
    progress("looking for the source")
    request = room.Request(found, out, machine, axis, known, force)
    return room.init(request, ask_number if at_terminal() else None)


@command("adopt move1.csv move2.csv --lead 10 --out machine.toml")
def adopt(
    traces: Traces,
    out: Annotated[Path, Option("Machine file to write.")],
    axis_number: AxisNumber,
    axis: Annotated[str | None, Option("Name of the axis.  [default: the file's, or X]")],
    screw: Screw,
    lead: Lead,
    keys: Keys,
    torque_constant: Annotated[
        float | None,
        Option("Torque constant of the motor, N m per A, or per unit of the torque column."),
    ],
    period: Annotated[
        float | None, Option("Sampling period, s, if no column holds the time.", kind=POSITIVE)
    ],
    columns: Annotated[
        tuple[str, ...],
        Option(
            "Content of a column, e.g. current=#6:mA; may be repeated.",
            "--column",
            metavar="QUANTITY=COLUMN[:UNIT]",
        ),
    ],
    plot: Annotated[Path | None, Option("PNG file for a picture of the channels as understood.")],
) -> Answer:
    """Propose a machine file from recordings of any kind.

    Every line has its reason. At a terminal it asks for what recordings cannot show; Enter leaves a
    question open.
    """
    from ..checks.columns.guess import Known
    from ..offline.adopt import adopt as run
    from ..offline.machine_text import stated

    sheet = stated(screw, lead, keys)
    lead_m = sheet.get("lead_m")
    known = Known(None if lead_m is None else float(lead_m), torque_constant, period)
    given = traces, out, axis_number, known, axis or "", sheet, columns, plot
    return run(*given, ask_number if at_terminal() else None)


@command("doctor deploy/drivers/modbus.toml --duration 30")
def doctor(
    sources: Annotated[tuple[Path, ...], "SOURCE..."],
    machine: MachineFile,
    axis_number: AxisNumber,
    axis: Annotated[str | None, Option("Only this axis of a configuration.")],
    send_test: Annotated[bool, Option("A test message by each output.")],
    duration: Annotated[float, Option("How long to listen, s.", kind=click.FloatRange(0.1))] = 10.0,
) -> Answer:
    """Examine a live source or a recording: rate, units, signs.

    SOURCE is a configuration, whose drivers are listened to while the axis moves, or recordings.
    Ends with status 1 if anything is doubtful.
    """
    from ..offline.doctor import examine_sources, examine_traces

    if sources[0].suffix != ".toml":
        if send_test:
            raise BadInputError("--send-test: expected a configuration, which states the outputs")
        return examine_traces(machine, sources, axis_number)
    if len(sources) > 1:
        raise BadInputError(f"doctor: {sources[1]}: expected one configuration, or recordings")
    if send_test:
        progress("sending a test message")
        return asyncio.run(_test_outputs(configured(sources[0])))
    progress(f"listening for {duration:g} s")
    return asyncio.run(examine_sources(configured(sources[0]), axis, duration))


async def _test_outputs(config: "EdgeConfig") -> Answer:
    from ..nodes.output_node import send_test

    words, tested = [], []
    for name in config.outputs:
        for receiver, problem in (await send_test(config, name)).items():
            said = problem or "has taken a test message"
            words.append(f"{f'{name} {receiver}'.strip()}: {said}")
            tested.append({"output": name, "receiver": receiver, "problem": problem or None})
    if not tested:
        raise BadInputError("--send-test: no output that takes events, such as mqtt or notify")
    status = INTERNAL_FAILURE if any(each["problem"] for each in tested) else DONE
    return Answer("\n".join(words), {"outputs": tested}, status)


@command("record --axis X --duration 60 --out trace.csv")
def record(
    config: Path | None,
    out: Annotated[Path, Option("File to write, .csv or .parquet.")],
    axis: Annotated[str | None, Option("Axis to record; the first configured one by default.")],
    duration: Annotated[float | None, Option("How long to record, s; or Ctrl-C.", kind=POSITIVE)],
    endpoint: Endpoint,
) -> Answer:
    """Write what the running service measures to a trace file."""
    from ..nodes.record_node import record_axis

    settings = configured(config, None, endpoint)
    if not settings.axes:
        raise BadInputError("axes: none yet")
    name = axis or settings.axes[0].name
    progress(f"recording axis {name}")
    rows, lost = asyncio.run(record_axis(settings, name, out, duration))
    words = f"{out}: {rows} rows of axis {name}, {lost} payloads lost"
    return Answer(words, {"out": str(out), "axis": name, "rows": rows, "lost_payloads": lost})


@command("replay --machine deploy/emps.toml trace.csv --speed 10")
def replay(
    trace: Path,
    config: Path | None,
    machine: MachineFile,
    axis_number: AxisNumber,
    hold: Annotated[bool, Option("Keep serving after the end of the recording.")],
    port: Port,
    speed: Annotated[
        float,
        Option("Multiple of real time; 0: as fast as possible.", kind=click.FloatRange(0.0)),
    ] = 1.0,
) -> Answer:
    """Play a recording through the whole service.

    CONFIG's axes and drivers are not used, nothing is kept; without it the bus takes a free port.
    """
    from ..config import EstimatorConfig
    from ..offline.replay import replay_trace

    log_to_stderr()
    settings = configured(config, port, None if config else "tcp/127.0.0.1:0")
    if config is None:  # that of the demonstration has the slow second opinion
        settings = settings.model_copy(update={"estimator": EstimatorConfig()})
    played = replay_trace(
        settings, trace, machine, speed, hold=hold, announce=announce, axis_number=axis_number
    )
    return asyncio.run(played)


@command("convert trace.xml --axis-number 7 --out trace.parquet")
def convert(
    source: Path,
    machine: MachineFile,
    axis_number: AxisNumber,
    out: Annotated[Path, Option("File to write, .csv, .parquet or .mcap.")],
    interpolate: Annotated[bool, Option("Interpolate positions that came more slowly.")],
    keep_all: Annotated[bool, Option("Keep columns that are not channels, too.", "--all")],
) -> Answer:
    """Convert a recording or the kept history to another format.

    SOURCE is text (CSV), Parquet, the XML of a SINUMERIK trace, a recording of Industrial Edge or a
    MATLAB 5 file; SINUMERIK and Industrial Edge names are known. The machine file gives the lead
    and, under [columns], names that take precedence. Of edge-service.sqlite the history of all axes
    is written, with a column `axis`.
    """
    from ..config import load_machine
    from ..offline.convert import convert as convert_trace
    from ..offline.convert import convert_history
    from ..recordings.forms import is_database
    from ..recordings.sinumerik.signals import ControllerAxis

    if is_database(source):
        return convert_history(source, out)
    model = load_machine(machine)
    axis = ControllerAxis(axis_number or model.axis.number, model.axis.lead_m, interpolate)
    return convert_trace(source, out, model, axis, keep_all=keep_all)


@command("stub modbus deploy/drivers/modbus.toml --fault delay:0.3", answers=False)
def stub(
    protocol: str,
    config: Path | None,
    axis: Annotated[str | None, Option("Axis to serve; by default all of this protocol.")],
    trace: Annotated[Path | None, Option("Recording to play once, not the simulated drive.")],
    port: Port,
    scenario: Annotated[
        Literal["healthy", "gradual", "partial", "sudden"],
        Option("How the simulated screw loses its preload."),
    ] = "healthy",
    fault: Annotated[str, Option("NAME[:amount]: delay, exception, stale, drop, ...")] = "none",
) -> None:
    """Imitate a machine over Modbus, OPC UA or MQTT.

    PROTOCOL is modbus, opcua or mqtt; CONFIG holds the map. Faults are set here, or written into
    the running server.
    """
    from drivers.stub import parse_fault

    from ..nodes.stub_node import make_stub, run_stub

    log_to_stderr()
    try:
        wanted = parse_fault(fault)
    except ValueError as error:
        raise BadInputError(f"--fault: {error}") from None
    made = partial(make_stub, protocol, configured(config), axis, scenario, trace, port)
    asyncio.run(run_stub(made, wanted, announce))
