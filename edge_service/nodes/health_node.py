"""Estimates, features, reports and commands in; condition and events out: all axes."""

import logging
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..config import HealthConfig
from ..config_tables import AlarmsConfig
from ..health.alarms.axis_alarms import AlarmSettings
from ..health.axis_monitor import AxisFacts, AxisMonitor
from ..health.settings import HealthSettings
from ..health.trend.usage import ScrewGeometry
from ..messages.alarm import Command
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentHealth, ComponentStatus
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, PRELOAD, STATUS
from ..models.machine import Machine
from .stores.watch_store import load_snapshot, save_snapshot
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter
from .wiring.stages import load_machines

log = logging.getLogger(__name__)
HEALTH_PERIOD_S = 1.0
SAVE_PERIOD_S = 10.0


def health_settings(config: HealthConfig) -> HealthSettings:
    """Settings of the condition from the configuration."""
    return HealthSettings(
        warning_below_percent=config.warning_percent_of_fresh,
        fault_below_percent=config.fault_percent_of_fresh,
    )


def alarm_settings(config: AlarmsConfig) -> AlarmSettings:
    """The alarms' settings from the configuration."""
    return AlarmSettings(**config.model_dump())


def axis_facts(axis: str, machine: Machine) -> AxisFacts:
    """Facts that the monitor of an axis needs of its machine file."""
    geometry = ScrewGeometry(machine.transmission_ratio_m_per_rad, machine.axis.stroke_m)
    return AxisFacts(axis, machine.fresh_preload_percent, geometry)


class _Monitors:
    """Monitors of all axes with their publishers."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._folder = config.history.folder
        settings, alarms = health_settings(config.health), alarm_settings(config.alarms)
        now_ns = time.time_ns()
        self.axes = {
            axis: AxisMonitor(axis_facts(axis, machine), settings, alarms, now_ns)
            for axis, machine in load_machines(config).items()
        }
        self._health = {axis: context.publisher(axis, HEALTH) for axis in self.axes}
        self._event = {axis: context.publisher(axis, EVENT) for axis in self.axes}

    def load(self) -> None:
        """Go on where the last process was."""
        if self._folder is not None:
            for monitor in self.axes.values():
                load_snapshot(self._folder, monitor)

    def save(self) -> None:
        """Keep what must outlive the process."""
        self.write(self.snapshots())

    def snapshots(self) -> dict[str, dict[str, Any]]:
        """State of every axis; only in the thread of the event loop."""
        if self._folder is None:
            return {}
        return {axis: monitor.snapshot() for axis, monitor in self.axes.items()}

    def write(self, snapshots: dict[str, dict[str, Any]]) -> None:
        """Write states, from any thread; a full disk is logged, and tried again."""
        try:
            for axis, snapshot in snapshots.items():
                save_snapshot(self._folder or Path(), axis, snapshot)
        except OSError as error:
            log.warning("%s: the state cannot be kept (%s)", self._folder, error.strerror)

    def publish(self, axis: str, events: Iterable[Event]) -> None:
        """Publish events, and the health that goes with them at once."""
        changed = False
        for event in events:
            self._event[axis].publish(event, event.time_ns)
            changed = True
        if changed:
            self.publish_health(axis)

    def publish_health(self, axis: str) -> None:
        """Publish the condition of an axis as of now."""
        now_ns = time.time_ns()
        self._health[axis].publish(self.axes[axis].health(now_ns), now_ns)

    def take_preload(self, axis: str, header: Header, estimate: PreloadEstimate) -> None:
        """Take an estimate in."""
        if axis in self.axes:
            self.publish(axis, self.axes[axis].on_preload(header, estimate, time.time_ns()))

    def take_features(self, axis: str, header: Header, block: FeatureBlock) -> None:
        """Take an interval in."""
        if axis in self.axes:
            self.publish(axis, self.axes[axis].on_feature(header, block, time.time_ns()))

    def take_report(self, axis: str, _header: Header, report: ComponentHealth) -> None:
        """Take a component's report in."""
        if axis in self.axes:
            self.publish(axis, self.axes[axis].on_component(report, time.time_ns()))

    def take_command(self, axis: str, _header: Header, command: Command) -> None:
        """Do what a person asks, and keep it at once."""
        if axis in self.axes:
            self.publish(axis, self.axes[axis].on_command(command, time.time_ns()))
            self.save()

    def renew(self, axis: str) -> None:
        """Let time pass on an axis."""
        self.publish(axis, self.axes[axis].tick(time.time_ns()))
        self.publish_health(axis)

    async def foresee(self, axis: str, heart: Heartbeat) -> None:
        """Make an axis' trend, if it is due."""
        monitor = self.axes[axis]
        if monitor.trend_is_due(time.time_ns()):
            trend = await heart.in_thread(monitor.trend_work())
            monitor.take_trend(trend, time.time_ns())


async def run(context: NodeContext) -> None:
    """Monitor every configured axis until cancelled."""
    monitors = _Monitors(context)
    preloads, features = context.subscribe(PRELOAD), context.subscribe(FEAT)
    reports = context.subscribe_to_components(STATUS)
    commands = context.subscribe(COMMAND)
    reporter = Reporter(context, "health")
    reporter.counters = preloads.counts

    def renew() -> None:
        for axis in monitors.axes:
            with tasks.failures.borne("renew", axis):
                monitors.renew(axis)

    async def foresee(heart: Heartbeat) -> None:
        while True:
            for axis in monitors.axes:
                with tasks.failures.borne("foresee", axis):
                    await monitors.foresee(axis, heart)
            await heart.sleep(HEALTH_PERIOD_S)

    async def keep(heart: Heartbeat) -> None:
        while True:
            await heart.sleep(SAVE_PERIOD_S)
            await heart.in_thread(monitors.write, monitors.snapshots())

    async with reporter.running() as tasks:
        monitors.load()
        reporter.to(ComponentStatus.OK)
        try:
            tasks.follow("preloads", preloads, monitors.take_preload, vital=True)
            tasks.follow("features", features, monitors.take_features, vital=True)
            tasks.follow("reports", reports, monitors.take_report)
            tasks.follow("commands", commands, monitors.take_command)
            tasks.repeat("renew", HEALTH_PERIOD_S, renew, vital=True)
            tasks.start("foresee", foresee)
            tasks.start("keep", keep)
            await context.forever()
        finally:
            monitors.save()
