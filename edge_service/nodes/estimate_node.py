"""Feature blocks in, preload estimates out: all axes."""

import asyncio
from functools import partial

import numpy as np

from ..config import EdgeConfig, EstimatorConfig
from ..estimate.interface import PreloadEstimator
from ..estimate.preload import ImmPreloadEstimator, ImmSettings
from ..messages.channels import ANGLE, TORQUE
from ..messages.codec import decode_features, encode_json
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import FEAT, PRELOAD
from ..models.machine import Machine
from .context import NodeContext, Reporter
from .downsample_node import make_downsampler
from .machines import load_machines


def make_estimator(config: EstimatorConfig, machine: Machine) -> PreloadEstimator:
    """The configured estimator for one axis."""
    return ImmPreloadEstimator(
        machine,
        ImmSettings(
            method=config.method,
            engine=config.engine,
            activation_exponent=config.activation_exponent,
            window_s=config.window_s,
        ),
    )


def _compile(config: EdgeConfig, machine: Machine) -> None:
    """Compile the kernels before the first sample: it takes seconds on a new installation."""
    time_s = np.arange(400, dtype=np.float64) / 1e3
    steady = SampleFrame(time_s, {TORQUE: 0.1 + 0.01 * np.sin(time_s), ANGLE: 10.0 * time_s})
    estimator = make_estimator(config.estimator, machine)
    for block in make_downsampler(config.downsample, machine).push(steady):
        estimator.update(block)


async def run(context: NodeContext) -> None:
    """Estimate every configured axis until cancelled."""
    config, bus = context.config, context.bus
    machines = load_machines(config)
    estimators = {
        axis: make_estimator(config.estimator, machine) for axis, machine in machines.items()
    }
    publishers = {axis: bus.publisher(config.keys.key(axis, PRELOAD), PRELOAD) for axis in machines}
    subscriber = bus.subscribe(config.keys.all_axes(FEAT), decode_features)
    reporter = Reporter(context, "estimate")
    reporter.counters = subscriber.counters.as_dict
    async with reporter.running():
        await asyncio.to_thread(_compile, config, next(iter(machines.values())))
        reporter.to(ComponentStatus.OK)
        async for axis, header, block in subscriber:
            if axis in estimators:
                estimators[axis].update(block)
                publishers[axis].publish(
                    partial(
                        encode_json, PRELOAD.payload, axis, payload=estimators[axis].estimate()
                    ),
                    header.source_time_ns,
                )
