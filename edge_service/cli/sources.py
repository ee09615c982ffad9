"""Commands about what samples come from: a driver's source, and a server that plays one."""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..command_answer import Answer
from ..exit_status import DONE, INTERNAL_FAILURE
from .options import (
    AXIS_NUMBER,
    CONFIG,
    MACHINE,
    PATH,
    InputError,
    answering,
    configured,
    service_config_option,
)
from .terminal import announce, log_to_stderr, progress

if TYPE_CHECKING:
    from ..config import EdgeConfig


@click.command(epilog="Example: edge-service doctor --config deploy/drivers/modbus.toml")
@click.argument("traces", nargs=-1, type=PATH)
@MACHINE
@AXIS_NUMBER
@service_config_option("Listen to the drivers of this configuration instead.")
@click.option("--axis", help="Check only this axis of --config; all by default.")
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.1),
    default=10.0,
    show_default=True,
    help="How long to listen to the drivers of --config.",
)
@click.option("--send-test", is_flag=True, help="Send a test message by each output of --config.")
@answering
def doctor(
    traces: tuple[Path, ...],
    machine: Path,
    axis_number: int | None,
    config: Path | None,
    axis: str | None,
    seconds: float,
    send_test: bool,
) -> list[Answer]:
    """Check a source against its configuration: rate, quality, units and signs.

    Pass recordings and their machine file, or --config to listen to live drivers while the axis
    moves. Ends with status 1 if anything is doubtful.
    """
    from ..offline.doctor import examine_sources, examine_traces

    if bool(traces) == (config is not None):
        raise InputError("doctor: expected either TRACES or --config")
    if send_test:
        if config is None:
            raise InputError("--send-test: expected --config, which states the outputs")
        progress("sending a test message")
        return asyncio.run(_test_outputs(configured(config)))
    if config is None:
        examined = [examine_traces(machine, traces, axis_number, progress)]
    else:
        progress(f"listening for {seconds:g} s")
        examined = asyncio.run(examine_sources(configured(config), axis, seconds))
    return [each.answer() for each in examined]


@dataclass(frozen=True, slots=True)
class SentTest:
    """Outcome of a test message to one receiver; the problem is null where it was taken."""

    output: str
    receiver: str
    problem: str | None


async def _test_outputs(config: "EdgeConfig") -> list[Answer]:
    from ..nodes.output_node import send_test

    answers = []
    for name in config.outputs:
        for receiver, problem in (await send_test(config, name)).items():
            words = f"{name} {receiver}".strip()
            said = f"{words}: {problem}" if problem else f"{words}: has taken a test message"
            sent = SentTest(output=name, receiver=receiver, problem=problem or None)
            answers.append(Answer(said, sent, INTERNAL_FAILURE if problem else DONE))
    if not answers:
        raise InputError("--send-test: no output that takes events, such as mqtt or notify")
    return answers


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
@click.option(
    "--recording", type=PATH, help="Play this recording once, instead of the simulated drive."
)
@click.option(
    "--nodesets",
    type=PATH,
    help="OPC UA: folder of companion specifications for the Machine Tool address space.",
)
@click.option("--port", type=click.IntRange(1, 65535), help="Port in place of the one in CONFIG.")
@click.option(
    "--fault",
    default="none",
    help="Fault to play, NAME[:amount]: delay, exception, stale, drop, ...",
)
def stub(
    protocol: str,
    config: Path | None,
    axis: str | None,
    scenario: str,
    recording: Path | None,
    nodesets: Path | None,
    port: int | None,
    fault: str,
) -> None:
    """Serve the simulated drive or a recording over a real protocol; CONFIG holds the map.

    PROTOCOL is modbus, opcua or mqtt. Set faults here, or write them into the running server.
    """
    from drivers.stub import parse_fault

    from ..nodes.stub_node import run_stub

    log_to_stderr()
    try:
        wanted = parse_fault(fault)
    except ValueError as error:
        raise InputError(f"--fault: {error}") from None
    settings = configured(config)
    asyncio.run(
        run_stub(protocol, settings, axis, scenario, nodesets, wanted, announce, recording, port)
    )
