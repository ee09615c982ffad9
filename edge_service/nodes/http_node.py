"""Service state from all topics, and the HTTP interface that serves it."""

import asyncio
import logging
from time import time_ns

from ..health.service_state import ServiceState
from ..health.settings import AxisLimits
from ..http_api.app import create_app
from ..http_api.limits.settings import HttpLimits
from ..http_api.serve import serve
from ..messages.alarm import Command
from ..messages.estimate import PreloadEstimate
from ..messages.header import Header
from ..messages.health import AxisHealth, ComponentHealth, ComponentStatus
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, PRELOAD, RAW
from ..models.screw.stroke_profile import stroke_profile
from .health_node import health_settings
from .jobs.job_desk import ProcessJobDesk
from .outputs.registry import OUTPUTS
from .stores.disagreement_recorder import DisagreementRecorder
from .stores.history_store import open_history
from .wiring.context import NodeContext, Reporter, each
from .wiring.stages import load_machines

log = logging.getLogger(__name__)


def _limits(context: NodeContext) -> dict[str, AxisLimits | None]:
    settings = health_settings(context.config.health)
    return {
        axis: settings.limits(machine.fresh_preload_percent)
        for axis, machine in load_machines(context.config).items()
    }


async def run(context: NodeContext) -> None:
    """Serve the API and the page until cancelled. Raises AddressError before anything is served."""
    config = context.config
    machines = load_machines(config)
    store = open_history(
        config, {axis: machine.transmission_ratio_m_per_rad for axis, machine in machines.items()}
    )
    state = ServiceState(
        _limits(context),
        time_ns(),
        keeping=store.keeping,
        strokes={axis: stroke_profile(machine) for axis, machine in machines.items()},
        place=config.keys,
    )
    preloads, healths = context.subscribe(PRELOAD), context.subscribe(HEALTH)
    features, events = context.subscribe(FEAT), context.subscribe(EVENT)
    samples = context.subscribe(RAW, depth=1024)
    reports = context.subscribe_to_components()
    outputs = [make(config) for make in OUTPUTS]
    machine_files = {axis.name: axis.machine for axis in config.axes}
    desk = ProcessJobDesk(config.history.folder, machine_files, config.jobs)
    reporter = Reporter(context, "http")
    reporter.counters = preloads.counts

    def take_preload(axis: str, header: Header, estimate: PreloadEstimate) -> None:
        state.on_preload(axis, header, estimate, time_ns())

    def take_health(_axis: str, header: Header, health: AxisHealth) -> None:
        state.on_health(header, health, time_ns())

    def take_report(_axis: str, _header: Header, report: ComponentHealth) -> None:
        state.on_component(report, time_ns())

    async def follow_events() -> None:
        async for _, _, event in events:
            state.on_event(event, time_ns())
            for output in outputs:
                output.put(event)
            recorder.note(event)

    async def follow_samples() -> None:
        async for axis, _, frame in samples:
            await recorder.follow(axis, frame)

    publishers = {axis: context.publisher(axis, COMMAND) for axis in machines}

    def send_command(axis: str, command: Command) -> None:
        publishers[axis].publish(command, time_ns())

    def on_kept(axis: str, name: str) -> None:
        send_command(axis, Command(action="recorded", user="edge-service", note=name))

    recorder = DisagreementRecorder(desk.folder, on_kept)

    def bound(host: str, port: int) -> None:
        reporter.to(ComponentStatus.OK)
        shown = f"[{host}]" if ":" in host else host
        context.on_http_ready(f"http://{shown}:{port}/")

    async with reporter.running():
        followers = [
            asyncio.create_task(follower)
            for follower in (
                each(preloads, take_preload),
                each(healths, take_health),
                each(features, state.on_feature),
                each(reports, take_report),
                follow_events(),
                follow_samples(),
                store.run(),
                *(output.run() for output in outputs),
            )
        ]
        try:
            await serve(
                create_app(state, time_ns, send_command=send_command, desk=desk),
                config.http.host,
                config.http.port,
                stop=asyncio.Event(),
                on_bound=bound,
                before_stop=state.close,
                limits=HttpLimits(connections=config.http.connections),
            )
        finally:
            for follower in followers:
                follower.cancel()
            await asyncio.gather(*followers, return_exceptions=True)
            await desk.close()
