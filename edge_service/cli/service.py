"""Commands that run the service, check what it would run, or copy what it keeps."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import click

from ..config import DEFAULT_CONFIG, EdgeConfig, load_config
from ..exit_status import DONE, INTERNAL_FAILURE
from ..messages.health import NODES
from ..messages.outputs import OF_HTTP
from .options import (
    AXIS_NUMBER,
    BUS,
    CONFIG,
    MACHINE,
    PATH,
    PORT,
    TRACE,
    InputError,
    configured,
    out_option,
    service_config_option,
)
from .terminal import announce, log_to_stderr


@click.command(epilog="Example: edge-service run deploy/edge.toml --port 8080")
@CONFIG
@PORT
@BUS
def run(config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run all nodes in one process: drives, bus, downsampling, estimator, health, HTTP.

    Without CONFIG, run a simulated drive with the built-in default configuration.
    """
    from ..nodes.service import run_service
    from ..nodes.wiring.memory import stay_small

    log_to_stderr()
    stay_small()
    asyncio.run(run_service(configured(config, port, endpoint), announce))


@click.command(epilog="Example: edge-service node bus edge.toml & edge-service node http edge.toml")
@click.argument("name", type=click.Choice(["bus", *sorted(NODES)]))
@CONFIG
@PORT
@BUS
def node(name: str, config: Path | None, port: int | None, endpoint: str | None) -> None:
    """Run a single node. `bus` is the router that all others connect to.

    Nodes identify themselves by certificates (`edge-service certs`), unless the bus is open.
    """
    from ..nodes.service import run_node
    from ..nodes.wiring.memory import stay_small

    log_to_stderr()
    stay_small()
    settings = configured(config, port, endpoint)
    asyncio.run(run_node(settings, name, announce))


@click.command("check-config", epilog="Example: edge-service check-config deploy/edge.toml")
@CONFIG
def check_config(config: Path | None) -> None:
    """Check a configuration, its machine files and driver settings, and sum it up."""
    for line in what_it_means(config or DEFAULT_CONFIG):
        click.echo(line)
    click.echo("configuration is right")


@click.command("send-test", epilog="Example: edge-service send-test email edge.toml")
@click.argument("output", type=click.Choice(OF_HTTP))
@CONFIG
def send_test(output: str, config: Path | None) -> int:
    """Send a test message by an output of events, as the service would, and say what came of it.

    Ends with status 1 if it is not taken.
    """
    from ..nodes.outputs.trial import try_output

    trial = asyncio.run(try_output(load_config(config or DEFAULT_CONFIG), output))
    if trial.problem:
        click.echo(f"{output}: {trial.place}: {trial.problem}", err=True)
        return INTERNAL_FAILURE
    click.echo(f"{output}: {trial.place} has taken a test message")
    return DONE


def what_it_means(config: Path) -> Iterator[str]:
    """Lines on a configuration that is right. Raises ConfigError."""
    from drivers.registry import driver_names

    from ..nodes.service import check_service
    from ..nodes.wiring.bus_certificates import check_bus
    from ..nodes.wiring.http_rights import check_access

    settings = load_config(config)
    unreachable = asyncio.run(check_service(settings))
    yield from _axes(settings)
    for line in unreachable:
        yield f"not reachable now: {line}"
    yield f"bus {settings.bus.endpoint}, http {settings.http.host}:{settings.http.port}"
    yield f"access: {check_access(settings.http)}; {check_bus(settings.bus)}"
    yield from _served(settings)
    yield _history(settings)
    yield f"drivers installed: {', '.join(driver_names())}"


def _axes(settings: EdgeConfig) -> Iterator[str]:
    """A line for each axis: where it comes from, and what can be said of it."""
    from ..nodes.wiring.stages import load_machines

    machines = load_machines(settings)
    for axis in settings.axes:
        missing = machines[axis.name].missing_for_percent()
        said = f"drag only ({missing} is unknown)" if missing else "preload in %"
        yield f"axis {axis.name}: driver {axis.driver}, machine {axis.machine}, {said}"


def _served(settings: EdgeConfig) -> Iterator[str]:
    """A line for each output that others read from us. Raises ConfigError for what cannot work."""
    if settings.opcua is not None:
        from ..nodes.outputs.opcua_rights import opcua_settings

        served = opcua_settings(settings)
        channel = "open" if served.certificate is None else "encrypted"
        users = "anybody" if served.knows is None else "whoever has a token"
        yield f"opcua {served.host}:{served.port}, {channel}, for {users}"


def _history(settings: EdgeConfig) -> str:
    folder = settings.history.folder
    if folder is None:
        return "history in memory, it ends with the service ([history] folder)"
    return f"history in {folder}, up to {settings.history.budget_mb:g} MB"


@click.command(
    epilog="Example: edge-service replay --machine deploy/emps.toml trace.csv --speed 10"
)
@TRACE
@MACHINE
@AXIS_NUMBER
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    help="Speed as a multiple of real time; 0 is as fast as possible.",
)
@click.option("--loop", is_flag=True, help="Begin again at the end of the recording.")
@click.option("--hold", is_flag=True, help="Keep serving after the end of the recording.")
@service_config_option("Service configuration; its axes are not used.")
@PORT
@BUS
def replay(
    trace: Path,
    machine: Path,
    axis_number: int | None,
    speed: float,
    loop: bool,
    hold: bool,
    config: Path | None,
    port: int | None,
    endpoint: str | None,
) -> None:
    """Play a recording through the whole service, and print the final answer."""
    from ..nodes.wiring.memory import stay_small
    from ..offline.replay import replay_trace

    log_to_stderr()
    stay_small()
    if speed < 0.0:
        raise InputError(f"--speed: {speed:g}, expected 0 or more")
    settings = configured(config, port, endpoint)
    for line in asyncio.run(
        replay_trace(
            settings,
            trace,
            machine,
            speed,
            loop=loop,
            hold=hold,
            announce=announce,
            axis_number=axis_number,
        )
    ):
        click.echo(line)


@click.command(epilog="Example: edge-service backup /etc/edge-service/edge.toml --out backup.zip")
@click.argument("config", type=PATH)
@out_option("File to write; it may hold secrets, and is for its owner alone.")
@click.option("--recordings", is_flag=True, help="Keep the recordings of the history as well.")
def backup(config: Path, out: Path, recordings: bool) -> None:
    """Copy the configuration, the files that it names and the history into one file.

    The service may be running.
    """
    from ..offline.backup.backup import back_up

    for line in back_up(config, out, recordings=recordings):
        click.echo(line)


@click.command(
    epilog="Example: edge-service restore backup.zip --config /etc/edge-service/edge.toml"
    " --history /var/lib/edge-service"
)
@click.argument("file", type=PATH)
@click.option("--config", type=PATH, help="Configuration to write, with the files that it names.")
@click.option("--history", type=PATH, help="History folder to fill; it must be empty.")
@click.option("--force", is_flag=True, help="Replace files of the configuration that differ.")
def restore(file: Path, config: Path | None, history: Path | None, force: bool) -> None:
    """Put back what `edge-service backup` has copied: all of it is checked before.

    No service may be running on that history.
    """
    from ..offline.backup import restore as backups

    if config is None and history is None:
        raise InputError("expected --config, --history or both: where to restore to")
    for line in backups.restore(file, config, history, force=force):
        click.echo(line)
