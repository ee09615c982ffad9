"""Raw samples and fast signals in, feature blocks out: all axes."""

from dataclasses import replace

from ..bus.refusals import Refusal
from ..downsample import Downsampler
from ..downsample.gathering import Gathering
from ..downsample.vibration import AxisVibration, VibrationSettings, orders_of
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import FEAT, RAW, WAVE
from ..messages.waveform import Waveform
from .wiring.context import NodeContext, Reporter
from .wiring.stages import WARM_UP_S, load_machines, make_downsampler, warm_up_downsampling

PREPARING = (
    "the downsampling is being prepared; after an installation or upgrade that takes a minute"
)


async def run(context: NodeContext) -> None:
    """Downsample every configured axis until cancelled."""
    machines = load_machines(context.config)
    downsamplers = {axis: make_downsampler(machine) for axis, machine in machines.items()}
    gatherings = {axis: Gathering() for axis in machines}
    publishers = {axis: context.publisher(axis, FEAT) for axis in machines}
    bands_hz = context.config.vibration.bands_hz
    vibrations = {
        axis: AxisVibration(VibrationSettings(bands_hz=bands_hz, orders=orders_of(machine)))
        for axis, machine in machines.items()
    }
    subscriber, waves = context.subscribe(RAW), context.subscribe(WAVE, depth=1024)
    reporter = Reporter(context, "downsample")
    reporter.counters = lambda: (
        subscriber.counts()
        | _fault_counts(downsamplers)
        | {"wave_gaps": sum(each.gaps for each in vibrations.values())}
    )

    def take(axis: str, header: Header, frame: SampleFrame) -> None:
        if axis not in downsamplers:
            return
        downsampler, vibration = downsamplers[axis], vibrations[axis]
        vibration.follow(frame)
        for gathered in gatherings[axis].add(frame, downsampler.due_s):
            for block in downsampler.push(gathered):
                columns = vibration.take()
                told = replace(block, vibration=columns) if columns else block
                publishers[axis].publish(told, source_time_ns(header, gathered, block))
        subscriber.rest(axis, downsampler.due_s - float(frame.time_s[-1]))

    def take_wave(axis: str, _header: Header, wave: Waveform) -> None:
        if axis in vibrations and not vibrations[axis].push(wave):
            waves.refusals.add(context.config.keys.key(axis, WAVE), Refusal.SURPLUS)

    async with reporter.running() as tasks:
        tasks.follow("waves", waves, take_wave)
        reporter.to(ComponentStatus.STARTING, PREPARING)
        await context.heart.in_thread(warm_up_downsampling, machines.values(), limit_s=WARM_UP_S)
        tasks.follow("samples", subscriber, take, vital=True)
        reporter.to(ComponentStatus.OK)
        await context.forever()


def source_time_ns(header: Header, frame: SampleFrame, block: FeatureBlock) -> int:
    """UNIX time of the interval's end: that of the frame's newest sample less the look ahead."""
    ahead_s = float(frame.time_s[-1]) - block.time_s
    return (
        header.source_time_ns - int(1e9 * ahead_s)
        if 0.0 <= ahead_s < 1.0
        else header.source_time_ns
    )


def _fault_counts(downsamplers: dict[str, Downsampler]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for downsampler in downsamplers.values():
        for name, count in downsampler.faults.items():
            counts[f"fault_{name.lower()}"] = counts.get(f"fault_{name.lower()}", 0) + count
    return counts
