"""Feature blocks in, preload estimates out: all axes."""

import asyncio
from functools import partial

from ..messages.codec import decode_features, encode_json
from ..messages.health import ComponentStatus
from ..messages.topics import FEAT, PRELOAD
from .context import NodeContext, Reporter
from .pipeline import load_machines, make_estimator, warm_up

SILENCE_NS = 10 * 10**9
"""Without features for this long, what was known before is of unknown age."""


async def run(context: NodeContext) -> None:
    """Estimate every configured axis until cancelled."""
    config, bus = context.config, context.bus
    machines = load_machines(config)
    estimators = {
        axis: make_estimator(config.estimator, machine) for axis, machine in machines.items()
    }
    publishers = {axis: bus.publisher(config.keys.key(axis, PRELOAD), PRELOAD) for axis in machines}
    subscriber = bus.subscribe(config.keys.all_axes(FEAT), decode_features, depth=1024)
    heard_ns: dict[str, int] = {}
    reporter = Reporter(context, "estimate")
    reporter.counters = subscriber.counters.as_dict
    async with reporter.running():
        await asyncio.to_thread(warm_up, config.downsample, config.estimator, machines.values())
        reporter.to(ComponentStatus.OK)
        async for axis, header, block in subscriber:
            if axis in estimators:
                if header.source_time_ns - heard_ns.get(axis, header.source_time_ns) > SILENCE_NS:
                    estimators[axis].interrupt()
                heard_ns[axis] = header.source_time_ns
                estimators[axis].update(block)
                publishers[axis].publish(
                    partial(
                        encode_json, PRELOAD.payload, axis, payload=estimators[axis].estimate()
                    ),
                    header.source_time_ns,
                )
