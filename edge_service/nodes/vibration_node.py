"""Fast signals in, features out; the signal itself is dropped, or kept around an event."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..bus.refusals import Refusal
from ..config import ConfigError
from ..config_tables import VibrationConfig
from ..downsample.signal_ring import SignalRing
from ..downsample.vibration import VibrationReducer, VibrationSettings
from ..messages.channels import ANGLE
from ..messages.event import Event, Severity
from ..messages.header import Header
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import EVENT, RAW, VIB, WAVE
from ..messages.vibration import VibrationFeatures
from ..messages.waveform import Waveform
from ..models.machine import Machine
from ..recordings.columns import TraceError
from ..recordings.writer import TraceWriter
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter
from .wiring.stages import load_machines

log = logging.getLogger(__name__)
_MOST_WAITING = 8
MOST_SENSORS = 32
"""Sensors of one axis; their names come from the bus."""


@dataclass(slots=True)
class _Sensor:
    """One sensor of one axis: its reducer, its latest signal, and the cuts that are due.

    Attributes:
        due: times on the axis' clock at which an event happened that is still to be kept.
    """

    reducer: VibrationReducer
    ring: SignalRing
    due: list[float] = field(default_factory=list)


class Sensors:
    """All sensors of all axes.

    Args:
        refuse: told the axis whose payload names one sensor too many.
    """

    def __init__(
        self,
        config: VibrationConfig,
        machines: Mapping[str, Machine],
        refuse: Callable[[str], None],
    ) -> None:
        self._config, self._refuse = config, refuse
        self._settings = {
            axis: VibrationSettings(
                config.interval_s, config.bands_hz, orders_of(config, machine), config.slip
            )
            for axis, machine in machines.items()
        }
        self._sensors: dict[tuple[str, str], _Sensor] = {}
        self.counts = {"waveforms": 0, "features": 0, "kept": 0}

    @property
    def gaps(self) -> int:
        """Times that a signal broke off."""
        return sum(sensor.reducer.gaps for sensor in self._sensors.values())

    def follow(self, axis: str, frame: SampleFrame) -> None:
        """The angle of the screw, for all sensors of the axis."""
        if ANGLE in frame.channels:
            for (owner, _), sensor in self._sensors.items():
                if owner == axis:
                    sensor.reducer.follow(frame.time_s, frame.channels[ANGLE])

    def push(self, axis: str, wave: Waveform) -> list[VibrationFeatures]:
        """A piece of a signal; returns the intervals that it completes."""
        self.counts["waveforms"] += 1
        sensor = self._sensors.get((axis, wave.sensor))
        if sensor is None:
            if sum(owner == axis for owner, _ in self._sensors) >= MOST_SENSORS:
                self._refuse(axis)
                return []
            keep_s = self._config.keep_before_s + self._config.keep_after_s + 1.0
            sensor = _Sensor(VibrationReducer(self._settings[axis]), SignalRing(keep_s))
            self._sensors[axis, wave.sensor] = sensor
        sensor.ring.push(wave)
        features = sensor.reducer.push(wave)
        self.counts["features"] += len(features)
        return features

    def note(self, event: Event) -> None:
        """Keep the signal around an event that asks for attention."""
        if self._config.keep_folder is None or event.severity is Severity.INFO:
            return
        for (axis, _), sensor in self._sensors.items():
            if axis == event.axis and not sensor.due:
                sensor.due.append(sensor.ring.newest_s)

    def cuts(self) -> list[tuple[Path, SampleFrame]]:
        """Signals that are due to be written, with the names of their files."""
        config, due = self._config, []
        for (axis, name), sensor in self._sensors.items():
            for at_s in list(sensor.due):
                if sensor.ring.newest_s >= at_s + config.keep_after_s:
                    sensor.due.remove(at_s)
                    cut = sensor.ring.cut(at_s - config.keep_before_s, at_s + config.keep_after_s)
                    if cut is not None and config.keep_folder is not None:
                        stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
                        due.append((config.keep_folder / f"{axis}_{name}_{stamp}.parquet", cut))
        return due


async def run(context: NodeContext) -> None:
    """Reduce what every axis' fast sensors send, until cancelled."""
    config = context.config
    if config.vibration is None:
        raise ConfigError("vibration: missing; the node needs a [vibration] table")
    publishers = {axis.name: context.publisher(axis.name, VIB) for axis in config.axes}
    waves = context.subscribe(WAVE, depth=1024)

    def refuse(axis: str) -> None:
        waves.refusals.add(config.keys.key(axis, WAVE), Refusal.SURPLUS)

    sensors = Sensors(config.vibration, load_machines(config), refuse)
    samples, events = context.subscribe(RAW), context.subscribe(EVENT)
    reporter = Reporter(context, "vibration")
    reporter.counters = lambda: waves.counts() | sensors.counts | {"gaps": sensors.gaps}

    cuts: asyncio.Queue[tuple[Path, SampleFrame]] = asyncio.Queue(_MOST_WAITING)

    def take_samples(axis: str, _header: Header, frame: SampleFrame) -> None:
        sensors.follow(axis, frame)

    def take_event(_axis: str, _header: Header, event: Event) -> None:
        sensors.note(event)

    def take_wave(axis: str, header: Header, wave: Waveform) -> None:
        if axis in publishers:
            for features in sensors.push(axis, wave):
                publishers[axis].publish(features, header.source_time_ns)
            for cut in sensors.cuts():
                if cuts.full():
                    log.warning("%s: the signal is not kept: the disk is too slow", cut[0])
                else:
                    cuts.put_nowait(cut)

    async def keep(heart: Heartbeat) -> None:
        while True:
            with heart.idle(cuts.empty):
                path, cut = await cuts.get()
            await heart.in_thread(_keep, path, cut)
            sensors.counts["kept"] += 1

    async with reporter.running() as tasks:
        reporter.to(ComponentStatus.OK)
        tasks.follow("samples", samples, take_samples)
        tasks.follow("events", events, take_event)
        tasks.follow("waves", waves, take_wave)
        tasks.start("keep", keep)
        await context.forever()


def orders_of(config: VibrationConfig, machine: Machine) -> Mapping[str, float]:
    """The orders to be looked at on an axis."""
    if config.orders is not None:
        return config.orders
    balls = machine.ball_pass_orders
    if balls is None:
        return {"screw": 1.0}
    return {"screw": 1.0, "ball_pass_nut": balls.on_nut, "ball_pass_screw": balls.on_screw}


def _keep(path: Path, cut: SampleFrame) -> None:
    """Write a signal; a full disk is logged and stops nothing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TraceWriter(path, tuple(cut.channels)) as writer:
            writer.write(cut)
        log.info("%s: %d values around an event", path, len(cut))
    except (TraceError, OSError) as error:
        log.warning("%s: the signal cannot be kept: %s", path, error)
