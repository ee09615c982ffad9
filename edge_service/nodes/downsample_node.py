"""Raw samples and fast signals in, feature blocks out: all axes."""

from collections import Counter
from dataclasses import replace

from ..bus.publisher import Publisher
from ..bus.reception import Refusal
from ..config import EdgeConfig
from ..downsample.rows import Gathering
from ..downsample.vibration import AxisVibration, orders_of
from ..messages.codec import Header
from ..messages.features import FeatureBlock
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame, Waveform
from ..messages.topics import FEAT, RAW, WAVE
from ..models.machine import Machine
from .component import Component
from .context import NodeContext
from .stages import PREPARING, make_downsampler


class AxisDownsampling:
    """Stages of one axis between its samples and its features."""

    def __init__(
        self, config: EdgeConfig, machine: Machine, publisher: Publisher[FeatureBlock]
    ) -> None:
        self.downsampler = make_downsampler(machine)
        self.vibration = AxisVibration(orders_of(machine), config.vibration.bands_hz)
        self._gathering = Gathering()
        self._heard_ns = self._told_ns = 0  # source times of the frame and the interval before
        self._publisher = publisher

    def take(self, header: Header, frame: SampleFrame) -> None:
        """Take samples in, and publish the intervals that they complete."""
        self.vibration.follow(frame)
        for gathered in self._gathering.add(frame, self.downsampler.due_s):
            for block in self.downsampler.push(gathered):
                vibration = self.vibration.take()
                told = replace(block, vibration=vibration) if vibration else block
                at_ns = source_time_ns(header, gathered, block, self._heard_ns)
                # flat out a frame holds more time than has passed since the one before
                self._told_ns = max(at_ns, min(self._told_ns, header.source_time_ns))
                self._publisher.publish(told, self._told_ns)
        self._heard_ns = header.source_time_ns


async def run(context: NodeContext) -> None:
    """Downsample every configured axis until cancelled."""
    publishers = context.publishers(FEAT)

    axes: dict[str, AxisDownsampling] = {}
    samples, waves = context.subscribe(RAW), context.subscribe(WAVE, depth=1024)

    def renew(axis: str) -> None:
        axes.pop(axis, None)
        samples.skip(axis)  # of a clock that is over
        waves.skip(axis)
        if axis in context.machines:
            axes[axis] = AxisDownsampling(context.config, context.machines[axis], publishers[axis])

    for axis in context.machines:
        renew(axis)
    context.renewals.append(renew)
    component = Component(context, "downsample")

    def counters() -> dict[str, int]:
        faults: Counter[str] = Counter()
        for each in axes.values():
            for name, count in each.downsampler.faults.items():
                faults[f"fault_{name.lower()}"] += count
        gaps = sum(each.vibration.gaps for each in axes.values())
        return samples.counts() | faults | {"wave_gaps": gaps}

    component.counters = counters

    def take(axis: str, header: Header, frame: SampleFrame) -> None:
        if axis in axes:
            axes[axis].take(header, frame)
            samples.rest(axis, axes[axis].downsampler.due_s - float(frame.time_s[-1]))

    def take_wave(axis: str, _header: Header, wave: Waveform) -> None:
        if axis in axes and not axes[axis].vibration.push(wave):
            waves.refusals.add(Refusal.SURPLUS)

    async with component.running():
        component.follow(waves, take_wave)
        component.to(ComponentStatus.STARTING, PREPARING)
        await context.prepared
        component.follow(samples, take)
        component.to(ComponentStatus.OK)
        await context.forever()


def source_time_ns(header: Header, frame: SampleFrame, block: FeatureBlock, before_ns: int) -> int:
    """UNIX time of the interval's end: the frame's less the look ahead, or that of before a gap."""
    ahead_s = float(frame.time_s[-1]) - block.time_s
    if 0.0 <= ahead_s < 1.0:
        return header.source_time_ns - int(1e9 * ahead_s)
    return before_ns or header.source_time_ns
