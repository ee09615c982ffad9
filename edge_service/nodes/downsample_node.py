"""Raw samples in, feature blocks out: all axes."""

from functools import partial

from ..bus.publisher import Publisher
from ..downsample import Downsampler
from ..messages.codec import decode_samples, encode_features
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import FEAT, RAW
from .context import NodeContext, Reporter
from .pipeline import load_machines, make_downsampler


async def run(context: NodeContext) -> None:
    """Downsample every configured axis until cancelled."""
    config, bus = context.config, context.bus
    machines = load_machines(config)
    downsamplers = {
        axis: make_downsampler(config.downsample, machine) for axis, machine in machines.items()
    }
    publishers = {axis: bus.publisher(config.keys.key(axis, FEAT), FEAT) for axis in machines}
    subscriber = bus.subscribe(config.keys.all_axes(RAW), decode_samples)
    reporter = Reporter(context, "downsample")
    reporter.counters = lambda: subscriber.counters.as_dict() | _fault_counts(downsamplers)
    async with reporter.running():
        reporter.to(ComponentStatus.OK)
        async for axis, header, frame in subscriber:
            if axis in downsamplers:
                for block in downsamplers[axis].push(frame):
                    _publish(publishers[axis], axis, block, source_time_ns(header, frame, block))


def source_time_ns(header: Header, frame: SampleFrame, block: FeatureBlock) -> int:
    """UNIX time of the interval's end: that of the frame's newest sample less the look ahead."""
    ahead_s = float(frame.time_s[-1]) - block.time_s
    return (
        header.source_time_ns - int(1e9 * ahead_s)
        if 0.0 <= ahead_s < 1.0
        else header.source_time_ns
    )


def _publish(publisher: Publisher, axis: str, block: FeatureBlock, source_ns: int) -> None:
    publisher.publish(partial(encode_features, axis, block=block), source_ns)


def _fault_counts(downsamplers: dict[str, Downsampler]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for downsampler in downsamplers.values():
        for name, count in downsampler.faults.items():
            counts[f"fault_{name.lower()}"] = counts.get(f"fault_{name.lower()}", 0) + count
    return counts
