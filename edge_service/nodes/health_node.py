"""Estimates, features and component reports in; condition and events out: all axes."""

import asyncio
import time
from collections.abc import Iterable
from functools import partial

from ..bus.publisher import Publisher
from ..config import HealthConfig
from ..health.judge import HealthJudge
from ..health.settings import HealthSettings
from ..messages.codec import decode_features, decode_json, encode_json
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event
from ..messages.health import AxisHealth, ComponentHealth, ComponentStatus
from ..messages.topics import EVENT, FEAT, HEALTH, PRELOAD, STATUS
from .context import NodeContext, Reporter
from .pipeline import load_machines

HEALTH_PERIOD_S = 1.0


def health_settings(config: HealthConfig) -> HealthSettings:
    """The judge's settings from the configuration."""
    return HealthSettings(
        warning_below_percent=config.warning_percent_of_fresh,
        fault_below_percent=config.fault_percent_of_fresh,
    )


class _Bench:
    """The judges of all axes with their publishers."""

    def __init__(self, context: NodeContext) -> None:
        config, bus = context.config, context.bus
        settings, now_ns = health_settings(config.health), time.time_ns()
        self.judges = {
            axis: HealthJudge(axis, machine.fresh_preload_percent, settings, now_ns)
            for axis, machine in load_machines(config).items()
        }
        self._health = {
            axis: bus.publisher(config.keys.key(axis, HEALTH), HEALTH) for axis in self.judges
        }
        self._event = {
            axis: bus.publisher(config.keys.key(axis, EVENT), EVENT) for axis in self.judges
        }

    def tell(self, axis: str, events: Iterable[Event]) -> None:
        """Publish events, and the health that goes with them at once."""
        told = False
        for event in events:
            _publish(self._event[axis], EVENT.payload, event, axis, event.time_ns)
            told = True
        if told:
            self.publish_health(axis)

    def publish_health(self, axis: str) -> None:
        """Publish the condition of an axis as of now."""
        now_ns = time.time_ns()
        health = self.judges[axis].health(now_ns)
        _publish(self._health[axis], HEALTH.payload, health, axis, now_ns)


def _publish(
    publisher: Publisher, schema: str, payload: Event | AxisHealth, axis: str, now_ns: int
) -> None:
    publisher.publish(partial(encode_json, schema, axis, payload=payload), now_ns)


async def run(context: NodeContext) -> None:
    """Judge every configured axis until cancelled."""
    config, bus = context.config, context.bus
    bench = _Bench(context)
    preloads = bus.subscribe(
        config.keys.all_axes(PRELOAD), partial(decode_json, PRELOAD.payload, PreloadEstimate)
    )
    features = bus.subscribe(config.keys.all_axes(FEAT), decode_features)
    reports = bus.subscribe(
        config.keys.all_components(STATUS), partial(decode_json, STATUS.payload, ComponentHealth)
    )
    reporter = Reporter(context, "health")
    reporter.counters = preloads.counters.as_dict

    async def follow_preloads() -> None:
        async for axis, header, estimate in preloads:
            if axis in bench.judges:
                bench.tell(axis, bench.judges[axis].on_preload(header, estimate, time.time_ns()))

    async def follow_features() -> None:
        async for axis, header, block in features:
            if axis in bench.judges:
                bench.tell(axis, bench.judges[axis].on_feature(header, block, time.time_ns()))

    async def follow_reports() -> None:
        async for axis, _, report in reports:
            if axis in bench.judges:
                bench.tell(axis, bench.judges[axis].on_component(report, time.time_ns()))

    async def renew() -> None:
        while True:
            for axis, judge in bench.judges.items():
                bench.tell(axis, judge.tick(time.time_ns()))
                bench.publish_health(axis)
            await asyncio.sleep(HEALTH_PERIOD_S)

    async with reporter.running(), asyncio.TaskGroup() as group:
        reporter.to(ComponentStatus.OK)
        for follow in (follow_preloads, follow_features, follow_reports, renew):
            group.create_task(follow())
