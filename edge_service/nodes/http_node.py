"""Everything that is heard goes on the board; the board is served."""

import asyncio
import logging
import time
from functools import partial

from ..health.board import Board
from ..health.settings import AxisLimits
from ..http_api.app import create_app
from ..http_api.serve import serve
from ..messages.codec import decode_json
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event
from ..messages.health import AxisHealth, ComponentHealth, ComponentStatus
from ..messages.topics import EVENT, HEALTH, PRELOAD, STATUS
from .context import NodeContext, Reporter
from .health_node import health_settings
from .pipeline import load_machines

log = logging.getLogger(__name__)


def _limits(context: NodeContext) -> dict[str, AxisLimits | None]:
    settings = health_settings(context.config.health)
    return {
        axis: settings.limits(machine.fresh_preload_percent)
        for axis, machine in load_machines(context.config).items()
    }


async def run(context: NodeContext) -> None:
    """Serve the API and the page until cancelled. Raises AddressError before anything is served."""
    config, bus = context.config, context.bus
    board = Board(_limits(context), time.time_ns())
    preloads = bus.subscribe(
        config.keys.all_axes(PRELOAD), partial(decode_json, PRELOAD.payload, PreloadEstimate)
    )
    healths = bus.subscribe(
        config.keys.all_axes(HEALTH), partial(decode_json, HEALTH.payload, AxisHealth)
    )
    events = bus.subscribe(config.keys.all_axes(EVENT), partial(decode_json, EVENT.payload, Event))
    reports = bus.subscribe(
        config.keys.all_components(STATUS), partial(decode_json, STATUS.payload, ComponentHealth)
    )
    reporter = Reporter(context, "http")
    reporter.counters = preloads.counters.as_dict

    async def follow_preloads() -> None:
        async for axis, header, estimate in preloads:
            board.on_preload(axis, header, estimate, time.time_ns())

    async def follow_healths() -> None:
        async for _, header, health in healths:
            board.on_health(header, health, time.time_ns())

    async def follow_events() -> None:
        async for _, _, event in events:
            board.on_event(event, time.time_ns())

    async def follow_reports() -> None:
        async for _, _, report in reports:
            board.on_component(report, time.time_ns())

    def bound(host: str, port: int) -> None:
        reporter.to(ComponentStatus.OK)
        shown = f"[{host}]" if ":" in host else host
        context.on_http_ready(f"http://{shown}:{port}/")

    async with reporter.running():
        followers = [
            asyncio.create_task(follow())
            for follow in (follow_preloads, follow_healths, follow_events, follow_reports)
        ]
        try:
            await serve(
                create_app(board, time.time_ns),
                config.http.host,
                config.http.port,
                stop=asyncio.Event(),
                on_bound=bound,
                before_stop=board.close,
            )
        finally:
            for follower in followers:
                follower.cancel()
            await asyncio.gather(*followers, return_exceptions=True)
