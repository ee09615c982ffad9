"""The `edge-service` command: reads arguments, calls a room, turns mistakes into one line."""

import asyncio
import json
import logging
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import click
from pydantic import ValidationError

from . import __version__
from .config import (
    DEFAULT_CONFIG,
    DEFAULT_MACHINE,
    ConfigError,
    EdgeConfig,
    explain,
    load_config,
    load_fleet,
)
from .config_tables import FleetConfig, FleetServiceConfig
from .studies.benches import BENCHES, Bench, BenchReport

BAD_INPUT, INTERNAL_FAILURE, INTERRUPTED = 2, 1, 130
_CONFIG = click.argument("config", type=click.Path(path_type=Path), required=False)
_MACHINE = click.option(
    "--machine",
    type=click.Path(path_type=Path),
    default=DEFAULT_MACHINE,
    show_default="the bench of the seed, deploy/machine.toml",
    help="Machine file: the baseline model.",
)


class InputError(Exception):
    """Bad input, told in one line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status (0 done, 2 bad input, 1 internal failure)."""
    try:
        status = cli.main(args=arguments, prog_name="edge-service", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return BAD_INPUT
    except click.ClickException as error:
        return _complain(error.format_message(), BAD_INPUT)
    except (KeyboardInterrupt, click.Abort):
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our pipe has gone; nothing is left to say
        return INTERNAL_FAILURE
    except Exception as error:  # the outermost edge: no traceback reaches a user
        return _explain(error)
    return status if isinstance(status, int) else 0


def _explain(error: Exception) -> int:
    if _is_bad_input(error):
        return _complain(str(error), BAD_INPUT)
    if os.environ.get("EDGE_SERVICE_DEBUG"):
        raise error
    kind = type(error).__name__
    return _complain(
        f"internal failure: {kind}: {error} (EDGE_SERVICE_DEBUG=1 shows where)", INTERNAL_FAILURE
    )


def _is_bad_input(error: Exception) -> bool:
    from .bus.session import BusConfigurationError, BusUnavailableError
    from .fingerprint.fingerprint_document import FingerprintError
    from .http_api.serve import AddressError
    from .models.motion import MotionError
    from .studies.diagnose_cases import BenchError
    from .studies.machine_gap import DiagnosisError
    from .studies.simulate import SimulationError
    from .trace.columns import TraceError

    bus = (BusConfigurationError, BusUnavailableError, AddressError)
    twin = (MotionError, SimulationError, FingerprintError, DiagnosisError, BenchError)
    return isinstance(error, (InputError, ConfigError, TraceError, *bus, *twin))


def _complain(line: str, status: int) -> int:
    click.echo(f"edge-service: {' '.join(line.split())}", err=True)
    return status


def _log_to_stderr() -> None:
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s"
    )


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="edge-service")
def cli() -> None:
    """Ball-screw preload from the signals a feed drive already has."""


@cli.command(epilog="Example: edge-service run deploy/edge.toml --port 8080")
@_CONFIG
@click.option("--port", type=click.IntRange(0, 65535), help="HTTP port; 0 takes a free one.")
@click.option("--bus", "endpoint", help="Endpoint of the bus, e.g. tcp/127.0.0.1:7447.")
def run(config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run all nodes in one process: drives, bus, downsampling, estimator, health, HTTP.

    Without CONFIG the simulated drive of the embedded default is run.
    """
    from .nodes.service import run_service

    _log_to_stderr()
    asyncio.run(run_service(_configured(config, port, endpoint), _announce))


@cli.command(epilog="Example: edge-service node bus & edge-service node http deploy/edge.toml")
@click.argument(
    "name",
    type=click.Choice(
        ["bus", "acquire", "downsample", "estimate", "health", "http", "mqtt", "vibration"]
    ),
)
@_CONFIG
@click.option("--port", type=click.IntRange(0, 65535), help="HTTP port; 0 takes a free one.")
@click.option("--bus", "endpoint", help="Endpoint of the bus, e.g. tcp/127.0.0.1:7447.")
def node(name: str, config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run one node alone. `bus` listens at the endpoint; every other node joins it there."""
    from .nodes.service import run_node

    _log_to_stderr()
    settings = _configured(config, port, endpoint)
    asyncio.run(run_node(settings, name, _announce))  # type: ignore[arg-type]


def _configured(config: Path | None, port: int | None, endpoint: str | None) -> EdgeConfig:
    settings = load_config(config or DEFAULT_CONFIG)
    if port is not None:
        settings = settings.model_copy(
            update={"http": settings.http.model_copy(update={"port": port})}
        )
    if endpoint is not None:
        settings = settings.model_copy(
            update={"bus": settings.bus.model_copy(update={"endpoint": endpoint})}
        )
    return settings


def _announce(address: str) -> None:
    click.echo(f"edge-service: serving {address}")


@cli.command("check-config", epilog="Example: edge-service check-config deploy/edge.toml")
@_CONFIG
def check_config(config: Path | None) -> None:
    """Check a configuration with its machine files and driver settings; print what it means."""
    from drivers.registry import driver_names

    from .nodes.pipeline import load_machines
    from .nodes.service import check_service

    settings = load_config(config or DEFAULT_CONFIG)
    unreachable = asyncio.run(check_service(settings))
    machines = load_machines(settings)
    for axis in settings.axes:
        missing = machines[axis.name].missing_for_percent()
        click.echo(
            f"axis {axis.name}: driver {axis.driver}, machine {axis.machine}, "
            + (f"drag only ({missing} is unknown)" if missing else "preload in %")
        )
    for line in unreachable:
        click.echo(f"not reachable now: {line}")
    click.echo(f"bus {settings.bus.endpoint}, http {settings.http.host}:{settings.http.port}")
    folder = settings.history.folder
    click.echo(
        "history in memory, it ends with the service ([history] folder)"
        if folder is None
        else f"history in {folder}, up to {settings.history.budget_mb:g} MB"
    )
    click.echo(f"drivers installed: {', '.join(driver_names())}")
    click.echo("configuration is right")


@cli.command(epilog="Example: edge-service record --axis X --duration 60 --out trace.csv")
@_CONFIG
@click.option("--axis", help="Axis to record; the first configured one by default.")
@click.option("--duration", "duration_s", type=click.FloatRange(min=0.0, min_open=True))
@click.option("--out", type=click.Path(path_type=Path), required=True, help=".csv or .parquet")
@click.option("--bus", "endpoint", help="Endpoint of the bus, e.g. tcp/127.0.0.1:7447.")
def record(
    config: Path | None, axis: str | None, duration_s: float | None, out: Path, endpoint: str | None
) -> None:
    """Write what a running service publishes to a trace file, until --duration or Ctrl-C."""
    from .nodes.record_node import record_axis

    settings = _configured(config, None, endpoint)
    name = axis or settings.axes[0].name
    rows, lost = asyncio.run(record_axis(settings, name, out, duration_s))
    click.echo(f"{out}: {rows} rows of axis {name}, {lost} payloads lost")


@cli.command(epilog="Example: edge-service replay --machine deploy/emps.toml trace.csv --speed 10")
@click.argument("trace", type=click.Path(path_type=Path))
@_MACHINE
@click.option(
    "--speed", default=1.0, show_default=True, help="Times real time; 0: as fast as possible."
)
@click.option("--loop", is_flag=True, help="Begin again at the end.")
@click.option("--hold", is_flag=True, help="Keep serving after the end.")
@click.option("--config", type=click.Path(path_type=Path), help="Configuration without its axes.")
@click.option("--port", type=click.IntRange(0, 65535), help="HTTP port; 0 takes a free one.")
@click.option("--bus", "endpoint", help="Endpoint of the bus, e.g. tcp/127.0.0.1:7447.")
def replay(
    trace: Path,
    machine: Path,
    speed: float,
    loop: bool,
    hold: bool,
    config: Path | None,
    port: int | None,
    endpoint: str | None,
) -> None:
    """Send a recording through the whole service, and print the last answer at its end."""
    from .nodes.replay_service import replay_trace

    _log_to_stderr()
    if speed < 0.0:
        raise InputError(f"--speed: {speed:g}, expected 0 or more")
    settings = _configured(config, port, endpoint)
    for line in asyncio.run(
        replay_trace(settings, trace, machine, speed, loop=loop, hold=hold, announce=_announce)
    ):
        click.echo(line)


@cli.command(
    epilog="Example: edge-service commission --machine m.toml healthy.csv --out commissioned.toml"
)
@click.argument("traces", nargs=-1, required=True, type=click.Path(path_type=Path))
@_MACHINE
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Machine file to write."
)
@click.option("--config", type=click.Path(path_type=Path), help="Length of the intervals.")
def commission(traces: tuple[Path, ...], machine: Path, out: Path, config: Path | None) -> None:
    """Learn from recordings of a healthy, cold axis what the estimator needs."""
    from .nodes.commission import commission_to_file

    service = load_config(config or DEFAULT_CONFIG)
    click.echo(commission_to_file(machine, traces, out, service))


@cli.command(epilog="Example: edge-service estimate --machine m.toml trace.csv --out estimates.csv")
@click.argument("trace", type=click.Path(path_type=Path))
@_MACHINE
@click.option("--out", type=click.Path(path_type=Path), required=True, help="CSV, a row per block.")
@click.option("--config", type=click.Path(path_type=Path), help="Choices of the estimator.")
@click.option(
    "--state",
    type=click.Path(path_type=Path),
    help="Go on from this file if it is there; leave it.",
)
def estimate(
    trace: Path, machine: Path, out: Path, config: Path | None, state: Path | None
) -> None:
    """Run the live estimator over a recording as fast as it can."""
    from .nodes.offline import estimate_to_csv

    service = load_config(config or DEFAULT_CONFIG)
    click.echo(estimate_to_csv(trace, machine, out, service, state))


@cli.command(epilog="Example: edge-service convert trace.xml --axis-number 7 --out trace.parquet")
@click.argument("source", type=click.Path(path_type=Path))
@_MACHINE
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Ends in .csv, .parquet or .mcap."
)
@click.option(
    "--axis-number",
    type=click.IntRange(1),
    show_default="the only one there, or 1",
    help="The controller's number of the axis.",
)
@click.option(
    "--torque-constant",
    "torque_constant_nm_per_a",
    type=click.FloatRange(0.0, min_open=True),
    help="N m per A: reads a current as torque where there is no torque.",
)
@click.option("--interpolate", is_flag=True, help="Draw slower positions as lines, not as steps.")
@click.option("--all", "keep_all", is_flag=True, help="Keep columns that are no channel.")
def convert(
    source: Path,
    machine: Path,
    out: Path,
    axis_number: int | None,
    torque_constant_nm_per_a: float | None,
    interpolate: bool,
    keep_all: bool,
) -> None:
    """Read a recording of any form and write it as a trace: CSV, Parquet or MCAP.

    SOURCE is CSV, Parquet or the XML of a SINUMERIK trace; SINUMERIK and Industrial Edge names are
    known. The machine file gives the lead and, under [columns], what comes before those names.
    """
    from .config import load_machine
    from .nodes.convert import controller_axis
    from .nodes.convert import convert as convert_trace

    model = load_machine(machine)
    axis = controller_axis(
        model, axis_number, torque_constant_nm_per_a, interpolate_positions=interpolate
    )
    with click.progressbar(
        length=1000, label="convert", file=sys.stderr, hidden=not sys.stderr.isatty()
    ) as bar:
        summary = convert_trace(
            source,
            out,
            model,
            axis,
            keep_all=keep_all,
            progress=lambda fraction: bar.update(int(1000 * fraction) - bar.pos),
        )
    click.echo(summary.as_text())


@cli.command(
    epilog="Example: edge-service simulate --motion friction --effect stribeck:excess_nm=0.2 "
    "--seed 7 --out trace.csv"
)
@_MACHINE
@click.option(
    "--motion",
    "motions",
    multiple=True,
    default=("production",),
    show_default="production",
    help="NAME[:duration_s=SECONDS]; several are run one after another on one axis.",
)
@click.option("--effect", "effects", multiple=True, help="NAME[:key=value,...]; repeatable.")
@click.option("--duration", "duration_s", type=float, help="Axis time, s; the motion's own.")
@click.option("--preload", "preload_percent", type=float, help="Percent; fresh by default.")
@click.option("--added-mass", "added_mass_kg", default=0.0, help="Weight plates, kg.")
@click.option("--external-force", "external_force_n", default=0.0, help="Loading screw, N.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(min=0))
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["csv", "parquet"]),
    help="Of the files in a folder; csv by default.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help=".csv or .parquet; with several motions a folder for 01_NAME.csv, 02_NAME.csv, ...",
)
def simulate(
    machine: Path,
    motions: tuple[str, ...],
    effects: tuple[str, ...],
    duration_s: float | None,
    preload_percent: float | None,
    added_mass_kg: float,
    external_force_n: float,
    seed: int,
    file_format: str | None,
    out: Path,
) -> None:
    """Record the simulated axis with any set of effects."""
    from .config import load_machine
    from .studies.simulate import SimulationSettings, simulate_session
    from .studies.simulate import simulate as run_simulation
    from .trace.writer import TraceFormat

    settings = SimulationSettings(
        motions[0], effects, duration_s, preload_percent, added_mass_kg, external_force_n, seed
    )
    if len(motions) == 1:
        if file_format is not None:
            raise InputError("--format: with one motion the name of --out says it")
        click.echo(run_simulation(load_machine(machine), settings, out, _progress))
        return
    if duration_s is not None:
        raise InputError("--duration: with several motions expected NAME:duration_s=SECONDS")
    files = TraceFormat(file_format or "csv")
    click.echo(simulate_session(load_machine(machine), settings, motions, out, files, _progress))


@cli.command(epilog="Example: edge-service motion next out/diagnosis.json --out setpoints.csv")
@click.argument("name", required=False)
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@_MACHINE
@click.option("--list", "list_all", is_flag=True, help="Name every motion; --out .png draws them.")
@click.option("--duration", "duration_s", type=float, help="Of the whole, s.")
@click.option("--rate", "rate_hz", default=1000.0, show_default=True, help="Setpoints per second.")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True)
@click.option("--clip", is_flag=True, help="Leave out what the axis does not allow, and name it.")
@click.option("--effect", "effects", multiple=True, help="With `next`: a tied effect; repeatable.")
@click.option("--motion", "rehearsed", help="With `isolability`: the motion to look at.")
@click.option("--out", type=click.Path(path_type=Path), help=".csv setpoints or .mpf NC program")
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
) -> None:
    """Write a motion for a controller: setpoints as CSV, or an NC program.

    `motion next DIAGNOSIS.json` proposes the shortest motion that tells apart what a diagnosis left
    tied, with the evidence to expect. `motion isolability TRACE`, or with --motion NAME, shows what
    a motion can tell apart, before anything is measured.

    It keeps to stroke, speed, acceleration and torque of the machine file, or is refused.
    """
    from .config import load_machine
    from .studies.motion_file import MotionFileSettings, list_motions, write_motion
    from .studies.motion_picture import write_motions_picture

    if list_all:
        click.echo(list_motions(load_machine(machine)))
        if out is not None:
            click.echo(write_motions_picture(load_machine(machine), out))
        return
    settings = MotionFileSettings(duration_s, rate_hz, seed, clip)
    if name == "next":
        from .studies.next_motion import next_motion, tied_effects, typical

        if len(files) + bool(effects) != 1:
            raise InputError("motion next: expected one DIAGNOSIS.json, or --effect twice or more")
        tied = tied_effects(files[0]) if files else typical(effects)
        click.echo(next_motion(load_machine(machine), tied, out, settings, _progress))
        return
    if name == "isolability":
        from .studies.isolability import isolability

        click.echo(isolability(load_machine(machine), rehearsed, files, _progress))
        return
    if files:
        raise InputError(f"motion: {files[0]}: {name} takes no file")
    if name is None or out is None:
        raise InputError("motion: expected a NAME and --out, or --list")
    click.echo(write_motion(name, load_machine(machine), out, settings, _progress))


@cli.command(epilog="Example: edge-service fingerprint friction.csv acceleration.csv --out out/now")
@click.argument("traces", nargs=-1, required=True, type=click.Path(path_type=Path))
@_MACHINE
@click.option("--baseline", type=click.Path(path_type=Path), help="An older fingerprint.json.")
@click.option("--pictures", type=click.Path(path_type=Path), help="Folder: pictures as PNG, too.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder.")
def fingerprint(
    traces: tuple[Path, ...],
    machine: Path,
    baseline: Path | None,
    pictures: Path | None,
    out: Path,
) -> None:
    """Test an axis from recordings: friction, stiffness, backlash, evenness, modes, preload.

    Several friction tests of one session are also drawn over one another, from first to last.
    """
    from .studies.fingerprint_report import fingerprint as run_fingerprint

    click.echo(run_fingerprint(machine, traces, out, baseline, pictures))


@cli.command(epilog="Example: edge-service gap --machine m.toml trace.csv --json")
@click.argument("traces", nargs=-1, required=True, type=click.Path(path_type=Path))
@_MACHINE
@click.option("--json", "as_json", is_flag=True, help="One JSON object: channel -> RMS.")
def gap(traces: tuple[Path, ...], machine: Path, as_json: bool) -> None:
    """How far model and machine are apart: torque in motion, and table against motor."""
    from .studies.machine_gap import gap as measure_gap

    found = measure_gap(machine, traces, _progress)
    if as_json:
        click.echo(json.dumps(found))
    else:
        for name, rms in found.items():
            click.echo(f"{name}: {rms:.4g}")


@cli.command(epilog="Example: edge-service diagnose --machine m.toml trace.csv --out out/diagnosis")
@click.argument("traces", nargs=-1, required=True, type=click.Path(path_type=Path))
@_MACHINE
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder.")
def diagnose(traces: tuple[Path, ...], machine: Path, out: Path) -> None:
    """Say where model and machine disagree, which effect causes it, and how far it shrinks."""
    from .studies.diagnose import diagnose as run_diagnosis

    click.echo(run_diagnosis(machine, traces, out, _progress))


@cli.command(epilog="Example: edge-service reproduce --out out/reproduce")
@click.argument("study", type=click.Choice(["thesis", "puzzle"]), default="thesis")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/reproduce"), show_default=True
)
def reproduce(study: str, out: Path) -> None:
    """Repeat the seed's simulations and its Table 4.2 beside the published figures.

    STUDY puzzle: why linear models would not fit its bench (Figure 5.13), told by the diagnosis.
    """
    if study == "puzzle":
        from .studies.puzzle import reproduce_puzzle

        click.echo(reproduce_puzzle(out, _progress))
        return
    from .studies.reproduce import reproduce as run_study

    click.echo(run_study(out, progress=_progress).as_text())
    click.echo(f"report: {out / 'report.html'}")


@cli.command(epilog="Example: edge-service doctor --config deploy/drivers/modbus.toml")
@click.argument("traces", nargs=-1, type=click.Path(path_type=Path))
@_MACHINE
@click.option("--config", type=click.Path(path_type=Path), help="Read its drivers instead.")
@click.option("--axis", help="One axis of --config; all by default.")
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.1),
    default=10.0,
    show_default=True,
    help="How long to listen to the drivers of --config.",
)
@click.option("--json", "as_json", is_flag=True, help="Findings as JSON, one object per axis.")
def doctor(
    traces: tuple[Path, ...],
    machine: Path,
    config: Path | None,
    axis: str | None,
    seconds: float,
    as_json: bool,
) -> None:
    """Check that a source is what its configuration says: rate, quality, units and signs.

    Give recordings and their machine file, or a configuration whose drivers shall be listened to
    while the axis moves.
    """
    from .nodes.doctor import examine_sources, examine_traces

    if bool(traces) == (config is not None):
        raise InputError("doctor: expected either TRACES or --config")
    if config is None:
        examined = [examine_traces(machine, traces)]
    else:
        examined = asyncio.run(examine_sources(load_config(config), axis, seconds))
    for each in examined:
        click.echo(each.as_json() if as_json else each.as_text())


@cli.command(
    epilog="Example: edge-service stub modbus deploy/drivers/modbus.toml --fault delay:0.3"
)
@click.argument("protocol")
@_CONFIG
@click.option("--axis", help="One axis; all that use this protocol by default.")
@click.option(
    "--scenario",
    type=click.Choice(["healthy", "gradual", "partial", "sudden"]),
    default="healthy",
    show_default=True,
    help="How the simulated screw loses its preload.",
)
@click.option(
    "--nodesets",
    type=click.Path(path_type=Path),
    help="OPC UA: folder of companion specifications for the Machine Tool address space.",
)
@click.option("--fault", default="none", help="NAME[:amount]: delay, exception, stale, drop, ...")
def stub(
    protocol: str,
    config: Path | None,
    axis: str | None,
    scenario: str,
    nodesets: Path | None,
    fault: str,
) -> None:
    """Serve the simulated drive over a real protocol, by the map that CONFIG gives its driver.

    PROTOCOL is modbus or opcua. Faults are given here, or written into the running server.
    """
    from drivers.stub import parse_fault

    from .nodes.stub_node import run_stub

    _log_to_stderr()
    try:
        wanted = parse_fault(fault)
    except ValueError as error:
        raise InputError(f"--fault: {error}") from None
    settings = load_config(config or DEFAULT_CONFIG)
    asyncio.run(run_stub(protocol, settings, axis, scenario, nodesets, wanted, _announce))


@cli.command(epilog="Example: edge-service fleet http://127.0.0.1:8080 --services fleet.toml")
@click.argument("addresses", nargs=-1)
@click.option("--services", type=click.Path(path_type=Path), help="TOML file with [[services]].")
@click.option(
    "--timeout", "timeout_s", type=click.FloatRange(0.1, 60.0), help="For all of it, s; 5."
)
@click.option("--json", "as_json", is_flag=True, help="Rows as JSON, one line per round.")
@click.option(
    "--watch", "period_s", type=click.FloatRange(1.0), help="Ask again after so many seconds."
)
def fleet(
    addresses: tuple[str, ...],
    services: Path | None,
    timeout_s: float | None,
    as_json: bool,
    period_s: float | None,
) -> None:
    """Show the axes of many services in one table, the worst first."""
    from .nodes.fleet import ask_fleet
    from .nodes.fleet_table import as_json_line, table_of

    settings = _fleet_of(addresses, services, timeout_s)
    while True:
        rows = ask_fleet(settings)
        if period_s is not None and sys.stdout.isatty() and not as_json:
            click.clear()
        click.echo(as_json_line(rows) if as_json else table_of(rows))
        if period_s is None:
            return
        sys.stdout.flush()
        time.sleep(period_s)


def _fleet_of(
    addresses: tuple[str, ...], services: Path | None, timeout_s: float | None
) -> FleetConfig:
    """Services that are named, and those of the file."""
    if not addresses and services is None:
        raise InputError("fleet: expected addresses, or --services with a file of them")
    try:
        named = tuple(FleetServiceConfig(address=each) for each in addresses)
    except ValidationError as error:
        raise InputError(f"fleet: {explain(error, FleetServiceConfig)}") from None
    listed = FleetConfig(services=named) if services is None else load_fleet(services)
    every = listed.services if services is None else (*named, *listed.services)
    wanted = listed.timeout_s if timeout_s is None else timeout_s
    return FleetConfig(timeout_s=wanted, services=every)


@cli.group(invoke_without_command=True, epilog="Example: edge-service bench identification")
@click.option("--quick", is_flag=True, help="Shorter measurements.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
@click.pass_context
def bench(context: click.Context, quick: bool, as_json: bool) -> None:
    """Measure speed and size: start, CPU, memory, delay, replay, estimator steps.

    The sub-commands measure how right the answers are.
    """
    if context.invoked_subcommand is not None:
        if quick or as_json:
            raise InputError(f"bench: options of {context.invoked_subcommand} come after its name")
        return
    from .studies.pipeline_bench import PipelineBenchSettings, run_pipeline_bench

    _print_report(run_pipeline_bench(PipelineBenchSettings(quick=quick), _progress), as_json)


def _print_report(report: BenchReport, as_json: bool) -> None:
    click.echo(json.dumps(report.as_dict(), indent=2) if as_json else report.as_text())


def _bench_command(each: Bench) -> click.Command:
    @click.command(
        each.name,
        help=each.purpose,
        epilog=f"Example: edge-service bench {each.name} --seeds {each.seeds // 10}",
    )
    @click.option(
        "--seeds", type=click.IntRange(1), default=each.seeds, show_default=True, help="Axes."
    )
    @click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
    def command(seeds: int, as_json: bool) -> None:
        _print_report(each.run(seeds, _progress), as_json)

    return command


for _each in BENCHES:
    bench.add_command(_bench_command(_each))


@bench.command("estimator", epilog="Example: edge-service bench estimator --quick")
@click.option("--quick", is_flag=True, help="Fewer axes, shorter runs.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
@click.option("--pictures", type=click.Path(path_type=Path), help="Folder: draw the rows instead.")
def bench_estimator(quick: bool, as_json: bool, pictures: Path | None) -> None:
    """Measure the preload estimate against two plants, beside the seed's and what was aimed at."""
    from .studies.estimator_bench import run_estimator_bench
    from .studies.estimator_foreign import CHECKOUT_TESTS
    from .studies.estimator_pictures import draw_estimator

    if pictures is not None:
        for file in draw_estimator(pictures, CHECKOUT_TESTS, quick, _progress):
            click.echo(file)
        return
    table = run_estimator_bench(quick, _progress)
    click.echo(table.as_json() if as_json else table.as_text())


@bench.command("diagnose", epilog="Example: edge-service bench diagnose --cases 20")
@click.option("--cases", type=click.IntRange(1), default=500, show_default=True, help="Cases.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the mixture of cases.")
@click.option("--out", type=click.Path(path_type=Path), help="Each case as a line of JSON.")
@click.option("--pictures", type=click.Path(path_type=Path), help="Folder: reliability, confusion.")
@click.option("--ties", type=click.IntRange(1), help="Instead: do proposed motions settle ties?")
def bench_diagnose(
    cases: int, seed: int, out: Path | None, pictures: Path | None, ties: int | None
) -> None:
    """Score the diagnosis on a plant that shares no code with the library (checkout only)."""
    if ties is not None:
        from .studies.diagnose_ties import run_ties

        click.echo(run_ties(ties, out, seed, _progress))
        return
    from .studies.diagnose_bench import run_diagnose_bench

    click.echo(run_diagnose_bench(cases, out, seed=seed, pictures=pictures, progress=_progress))


@bench.command("drivers", epilog="Example: edge-service bench drivers --quick")
@click.option("--quick", is_flag=True, help="Shorter measurements.")
@click.option("--json", "as_json", is_flag=True, help="Figures as JSON.")
def bench_drivers(quick: bool, as_json: bool) -> None:
    """Measure polls and notifications, many devices in one process, and one that hangs."""
    from .studies.drivers_bench import DriversBenchSettings, run_drivers_bench

    figures = run_drivers_bench(DriversBenchSettings(quick=quick), _progress)
    click.echo(json.dumps(figures.as_dict(), indent=2) if as_json else figures.as_text())


def _progress(line: str) -> None:
    """Tell a person at a terminal, or a service that asks, what is being done; else stay quiet."""
    if sys.stderr.isatty() or os.environ.get("EDGE_SERVICE_PROGRESS"):
        click.echo(line, err=True)
