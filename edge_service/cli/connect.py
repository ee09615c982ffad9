"""Commands that connect a machine: its configuration, its machine file, what samples come from."""

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from ..exit_status import DONE, INTERNAL_FAILURE
from .options import (
    AXIS_NUMBER,
    BUS,
    CONFIG,
    FRESH,
    LEAD,
    MACHINE,
    PATH,
    PORT,
    POSITIVE,
    SCREW,
    SET,
    TRACE,
    TRACES,
    InputError,
    answering,
    configured,
    out_option,
)
from .terminal import announce, ask_number, at_terminal, log_to_stderr, progress

if TYPE_CHECKING:
    from ..config import EdgeConfig


@click.command(
    epilog='Example: edge-service init opc.tcp://192.168.0.5:4840 --screw "20x10 C18200 P900"'
)
@click.argument("source", required=False)
@click.option("--machine", type=PATH, help="Machine file of the axis; else one is written.")
@SCREW
@LEAD
@SET
@click.option("--axis", default="X", show_default=True, help="Name of the axis.")
@click.option(
    "--out", type=PATH, default="edge.toml", show_default=True, help="Configuration to write."
)
@FRESH
@answering
def init(
    source: str | None,
    machine: Path | None,
    screw: str | None,
    lead: float | None,
    keys: tuple[str, ...],
    axis: str,
    out: Path,
    force: bool,
) -> Answer:
    """Write a first configuration for a device or a recording.

    SOURCE is the device (modbus://HOST:PORT, opc.tcp://HOST:PORT, mqtt://HOST:PORT/TOPIC, or a
    HOST, which is asked what it is) or a recording of the axis, which `adopt` then reads. Without
    SOURCE this computer is searched. At a terminal it asks for what is missing. Ends with status 1
    if the device does not fit its signals yet.
    """
    from ..offline.init import Request, devices_here, no_device, source_of
    from ..offline.init import init as run
    from ..offline.machine_text import stated

    known = stated(screw, lead, keys)
    progress("looking for the source")
    if source is None:
        found = devices_here()
        if at_terminal():
            click.echo(f"devices on this computer: {', '.join(found) or 'none'}")
            source = click.prompt("Device or recording", default=found[0] if found else None)
        elif len(found) == 1:
            source = found[0]
        else:
            raise InputError(no_device(found))
    request = Request(source_of(source), out, machine, axis, known, force)
    return run(request, ask_number if at_terminal() else None, progress)


@click.command(
    epilog="Example: edge-service adopt move1.csv move2.csv --lead 10 --out machine.toml"
)
@TRACES
@out_option("Machine file to write.")
@AXIS_NUMBER
@click.option("--axis", help="Name of the axis.  [default: as the file spells it, or X]")
@SCREW
@LEAD
@SET
@click.option(
    "--torque-constant",
    type=click.FloatRange(),
    help="Torque constant of the motor, N m per A, or per unit of the torque column.",
)
@click.option("--period", type=POSITIVE, help="Sampling period, s, if no column holds the time.")
@click.option(
    "--column",
    "columns",
    multiple=True,
    metavar="QUANTITY=COLUMN[:UNIT]",
    help="Content of a column, e.g. current=#6:mA; may be repeated.",
)
@click.option("--plot", type=PATH, help="PNG file for a picture of the channels as understood.")
@answering
def adopt(
    traces: tuple[Path, ...],
    out: Path,
    axis_number: int | None,
    axis: str | None,
    screw: str | None,
    lead: float | None,
    keys: tuple[str, ...],
    torque_constant: float | None,
    period: float | None,
    columns: tuple[str, ...],
    plot: Path | None,
) -> Answer:
    """Propose a machine file from recordings of any kind.

    Every line has its reason. At a terminal it asks for what recordings cannot show; Enter leaves a
    question open.
    """
    from ..checks.columns.guess import Known
    from ..offline.adopt import Request
    from ..offline.adopt import adopt as run
    from ..offline.machine_text import stated

    sheet = stated(screw, lead, keys)
    lead_m = sheet.get("lead_m")
    known = Known(None if lead_m is None else float(lead_m), torque_constant, period)
    request = Request(traces, out, axis_number, known, axis, sheet, columns, plot)
    return run(request, ask_number if at_terminal() else None, progress)


@click.command(epilog="Example: edge-service doctor deploy/drivers/modbus.toml --duration 30")
@click.argument("sources", nargs=-1, required=True, type=PATH, metavar="SOURCE...")
@MACHINE
@AXIS_NUMBER
@click.option("--axis", help="Only this axis of a configuration.")
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0.1),
    default=10.0,
    show_default=True,
    help="How long to listen, s.",
)
@click.option("--send-test", is_flag=True, help="A test message by each output.")
@answering
def doctor(
    sources: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    axis: str | None,
    duration_s: float,
    send_test: bool,
) -> Answer:
    """Examine a live source or a recording: rate, units, signs.

    SOURCE is a configuration, whose drivers are listened to while the axis moves, or recordings.
    Ends with status 1 if anything is doubtful.
    """
    from ..offline.doctor import examine_sources, examine_traces

    config = sources[0] if sources[0].suffix == ".toml" else None
    if config is not None and len(sources) > 1:
        raise InputError(f"doctor: {sources[1]}: expected one configuration, or recordings")
    if config is None:
        if send_test:
            raise InputError("--send-test: expected a configuration, which states the outputs")
        return examine_traces(machine, sources, axis_number, progress)
    if send_test:
        progress("sending a test message")
        return asyncio.run(_test_outputs(configured(config)))
    progress(f"listening for {duration_s:g} s")
    return asyncio.run(examine_sources(configured(config), axis, duration_s))


async def _test_outputs(config: "EdgeConfig") -> Answer:
    from ..nodes.output_node import send_test

    words, tested = [], []
    for name in config.outputs:
        for receiver, problem in (await send_test(config, name)).items():
            words.append(
                f"{name} {receiver}".strip() + f": {problem or 'has taken a test message'}"
            )
            tested.append({"output": name, "receiver": receiver, "problem": problem or None})
    if not tested:
        raise InputError("--send-test: no output that takes events, such as mqtt or notify")
    status = INTERNAL_FAILURE if any(each["problem"] for each in tested) else DONE
    return Answer("\n".join(words), {"outputs": tested}, status)


@click.command(epilog="Example: edge-service record --axis X --duration 60 --out trace.csv")
@CONFIG
@out_option("File to write, .csv or .parquet.")
@click.option("--axis", help="Axis to record; the first configured one by default.")
@click.option("--duration", "duration_s", type=POSITIVE, help="How long to record, s; or Ctrl-C.")
@BUS
@answering
def record(
    config: Path | None, out: Path, axis: str | None, duration_s: float | None, endpoint: str | None
) -> Answer:
    """Write what the running service measures to a trace file."""
    from ..nodes.record_node import record_axis

    settings = configured(config, None, endpoint)
    name = axis or settings.axes[0].name
    progress(f"recording axis {name}")
    rows, lost = asyncio.run(record_axis(settings, name, out, duration_s))
    words = f"{out}: {rows} rows of axis {name}, {lost} payloads lost"
    return Answer(words, {"out": str(out), "axis": name, "rows": rows, "lost_payloads": lost})


@click.command(
    epilog="Example: edge-service replay --machine deploy/emps.toml trace.csv --speed 10"
)
@TRACE
@CONFIG
@MACHINE
@AXIS_NUMBER
@click.option(
    "--speed",
    type=click.FloatRange(0.0),
    default=1.0,
    show_default=True,
    help="Multiple of real time; 0: as fast as possible.",
)
@click.option("--hold", is_flag=True, help="Keep serving after the end of the recording.")
@PORT
@answering
def replay(
    trace: Path,
    config: Path | None,
    machine: Path,
    axis_number: int | None,
    speed: float,
    hold: bool,
    port: int | None,
) -> Answer:
    """Play a recording through the whole service.

    Axes and drivers of CONFIG are not used; without CONFIG the bus takes a free port.
    """
    from ..offline.replay import replay_trace

    log_to_stderr()
    settings = configured(config, port, None if config else "tcp/127.0.0.1:0")
    played = replay_trace(
        settings, trace, machine, speed, hold=hold, announce=announce, axis_number=axis_number
    )
    return asyncio.run(played)


@click.command(epilog="Example: edge-service convert trace.xml --axis-number 7 --out trace.parquet")
@click.argument("source", type=PATH)
@MACHINE
@AXIS_NUMBER
@out_option("File to write, .csv, .parquet or .mcap.")
@click.option("--interpolate", is_flag=True, help="Interpolate positions that came more slowly.")
@click.option("--all", "keep_all", is_flag=True, help="Keep columns that are not channels, too.")
@answering
def convert(
    source: Path,
    machine: Path,
    axis_number: int | None,
    out: Path,
    interpolate: bool,
    keep_all: bool,
) -> Answer:
    """Convert a recording or the kept history to another format.

    SOURCE is text (CSV), Parquet, the XML of a SINUMERIK trace, a recording of Industrial Edge or a
    MATLAB 5 file; SINUMERIK and Industrial Edge names are known. The machine file gives the lead
    and, under [columns], names that take precedence. Of edge-service.sqlite the history of all axes
    is written, with a column `axis`.
    """
    from ..config import load_machine
    from ..offline.convert import convert as convert_trace
    from ..offline.convert import convert_history, is_database
    from ..offline.recordings import controller_axis

    if is_database(source):
        return convert_history(source, out, progress)
    model = load_machine(machine)
    axis = controller_axis(model, axis_number, interpolate_positions=interpolate)
    summary = convert_trace(source, out, model, axis, keep_all=keep_all, progress=progress)
    return Answer(summary.as_text(), summary)


@click.command(
    epilog="Example: edge-service stub modbus deploy/drivers/modbus.toml --fault delay:0.3"
)
@click.argument("protocol")
@CONFIG
@click.option("--axis", help="Serve only this axis; by default all that use this protocol.")
@click.option(
    "--scenario",
    type=click.Choice(["healthy", "gradual", "partial", "sudden"]),
    default="healthy",
    show_default=True,
    help="How the simulated screw loses its preload.",
)
@click.option("--trace", type=PATH, help="Recording to play once, not the simulated drive.")
@click.option("--fault", default="none", help="NAME[:amount]: delay, exception, stale, drop, ...")
@PORT
def stub(
    protocol: str,
    config: Path | None,
    axis: str | None,
    scenario: str,
    trace: Path | None,
    fault: str,
    port: int | None,
) -> None:
    """Imitate a machine over Modbus, OPC UA or MQTT.

    PROTOCOL is modbus, opcua or mqtt; CONFIG holds the map. Faults are set here, or written into
    the running server.
    """
    from drivers.stub import parse_fault

    from ..nodes.stub_node import run_stub

    log_to_stderr()
    try:
        wanted = parse_fault(fault)
    except ValueError as error:
        raise InputError(f"--fault: {error}") from None
    settings = configured(config)
    asyncio.run(run_stub(protocol, settings, axis, scenario, wanted, announce, trace, port))
