"""Estimates, features, reports and commands in; condition and events out: all axes."""

from collections.abc import Callable, Sequence
from functools import partial

from ..clock import CLOCK, now_ns
from ..config import HealthConfig
from ..config_tables import AlarmsConfig
from ..health.advice.announced import announced
from ..health.alarms.axis_alarms import AlarmSettings
from ..health.axis_events import state_damaged
from ..health.axis_monitor import AxisFacts, AxisMonitor
from ..health.events.audit import AuditEntry
from ..health.events.kinds import is_chatter
from ..health.settings import HealthSettings
from ..health.trend.usage import ScrewGeometry
from ..messages.alarm import Command, Outcome
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentHealth, ComponentStatus
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, PRELOAD, STATUS
from ..models.machine import Machine
from .stores.watch_store import State, WatchStore
from .supervision.heartbeat import Heartbeat
from .wiring.announcer import Announcement, Announcer
from .wiring.commands import NotedCommand, obey_all
from .wiring.context import NodeContext, Reporter
from .wiring.stages import load_machines

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
    """Monitors of all axes: what they say is kept, then announced."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._diary = context.diary.diary
        self.store = WatchStore(config.history.folder)
        settings, alarms = health_settings(config.health), alarm_settings(config.alarms)
        begun_ns = now_ns()
        self.axes = {
            axis: self.store.load(
                axis, partial(AxisMonitor, axis_facts(axis, machine), settings, alarms, begun_ns)
            )
            for axis, machine in load_machines(config).items()
        }
        for axis in self.axes:  # what a crash may have kept out of the diary
            self._diary.add(self.store.announced(axis), begun_ns)
        damages = [state_damaged(*each, begun_ns) for each in self.store.damages]
        self._diary.add(damages, begun_ns)
        self._health = {axis: context.publisher(axis, HEALTH) for axis in self.axes}
        self._event = {axis: context.publisher(axis, EVENT) for axis in self.axes}
        self.announcer = Announcer(self._keep, self._publish)

    def problems(self) -> list[str]:
        """Reason for which nothing is kept of what is said; empty if it is."""
        return [each for each in (self.store.problem, self._diary.problem) if each]

    def keep(self) -> None:
        """Keep the state of every axis."""
        for axis in self.axes:
            self._announce(axis, (), keeps=True)

    def end(self) -> None:
        """Keep all that must outlive the process, now."""
        self.keep()
        self.announcer.flush()

    def take_preload(self, axis: str, header: Header, estimate: PreloadEstimate) -> None:
        """Take an estimate in."""
        if axis in self.axes:
            self._say(axis, self.axes[axis].on_preload(header, estimate, now_ns()))

    def take_features(self, axis: str, header: Header, block: FeatureBlock) -> None:
        """Take an interval in."""
        if axis in self.axes:
            self._say(axis, self.axes[axis].on_feature(header, block, now_ns()))

    def take_report(self, axis: str, _header: Header, report: ComponentHealth) -> None:
        """Take the report in of a component of one axis, or of all axes."""
        for each in self.axes if report.axis is None else (axis,):
            if each in self.axes:
                self._say(each, self.axes[each].on_component(report, now_ns()))

    def take_command(self, axis: str, _header: Header, command: Command) -> None:
        """Do what a client of the bus asks."""
        if axis in self.axes:
            self.obey(axis, command)

    def obey(
        self, axis: str, command: Command, told: Callable[[Outcome], None] = lambda _outcome: None
    ) -> None:
        """Do what is asked of an axis; the outcome is told once it is kept."""
        at_ns, monitor = now_ns(), self.axes[axis]
        known, change = monitor.answered(command), NotedCommand(axis, command, at_ns)
        outcome, events = (known, ()) if known else monitor.obey(command, at_ns)

        def tell(problem: str) -> None:
            message = problem or outcome.message
            told(outcome.model_copy(update={"kept": not problem, "message": message}))

        noted = () if known else change.outcome(outcome)
        intents = change.intent() if events else ()
        self._announce(axis, events, noted, tell, intents=intents, keeps=bool(command.key))

    def renew(self, axis: str) -> None:
        """Let time pass on an axis, and announce its condition."""
        self._announce(axis, self.axes[axis].tick(now_ns()))

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        for monitor in self.axes.values():
            monitor.move(step_ns)

    async def foresee(self, axis: str, heart: Heartbeat) -> None:
        """Make an axis' trend, if it is due."""
        monitor = self.axes[axis]
        if monitor.trend_is_due(now_ns()):
            trend = await heart.in_thread(monitor.trend_work())
            monitor.take_trend(trend, now_ns())

    def _say(self, axis: str, events: tuple[Event, ...]) -> None:
        """Announce events, if there are any, with the condition that goes with them."""
        if events:
            self._announce(axis, events)

    def _announce(
        self,
        axis: str,
        events: tuple[Event, ...],
        entries: tuple[AuditEntry, ...] = (),
        told: Callable[[str], None] = lambda _problem: None,
        *,
        intents: tuple[AuditEntry, ...] = (),
        keeps: bool = False,
    ) -> None:
        monitor = self.axes[axis]
        keeps = keeps or any(not is_chatter(event.kind) for event in events)
        snapshot = monitor.snapshot() if keeps else None
        health = monitor.health(now_ns())
        events = announced(events, health)
        self.announcer.put(Announcement(axis, events, health, snapshot, entries, told, intents))

    def _keep(self, batch: Sequence[Announcement]) -> str:
        events = [event for each in batch for event in each.events]
        states = [State(each.axis, each.order, each.snapshot) for each in batch if each.snapshot]
        intents = [intent for each in batch for intent in each.intents]
        if intents:  # on the disk before what they announce
            self._diary.add((), now_ns(), intents)
        problem = self.store.save(states, events) if states else ""
        self._diary.add(events, now_ns(), [entry for each in batch for entry in each.entries])
        return problem or self._diary.problem

    def _publish(self, announcement: Announcement) -> None:
        axis = announcement.axis
        for event in announcement.events:
            self._event[axis].publish(event, event.time_ns)
        self._health[axis].publish(announcement.health, now_ns())


async def run(context: NodeContext) -> None:
    """Monitor every configured axis until cancelled."""
    monitors = _Monitors(context)
    preloads, features = context.subscribe(PRELOAD), context.subscribe(FEAT)
    reports = context.subscribe_to_components(STATUS)
    commands = context.subscribe(COMMAND)
    reporter = Reporter(context, "health")
    reporter.counters = lambda: preloads.counts() | {"damaged_files": len(monitors.store.damages)}
    reporter.problems = monitors.problems

    def renew() -> None:
        for axis in monitors.axes:
            with tasks.failures.borne("renew", axis):
                monitors.renew(axis)

    async def foresee(heart: Heartbeat) -> None:
        while True:
            for axis in monitors.axes:
                with tasks.failures.borne("foresee", axis):
                    await monitors.foresee(axis, heart)
            await heart.next(HEALTH_PERIOD_S)

    async def keep(heart: Heartbeat) -> None:
        while True:
            await heart.sleep(HEALTH_PERIOD_S if monitors.store.problem else SAVE_PERIOD_S)
            monitors.keep()

    async with reporter.running() as tasks:
        reporter.to(ComponentStatus.OK)
        try:
            tasks.start("announce", monitors.announcer.announce, vital=True)
            tasks.start("write", monitors.announcer.write)
            tasks.follow("preloads", preloads, monitors.take_preload, vital=True)
            tasks.follow("features", features, monitors.take_features, vital=True)
            tasks.follow("reports", reports, monitors.take_report)
            tasks.follow("commands", commands, monitors.take_command)
            tasks.repeat("renew", HEALTH_PERIOD_S, renew, vital=True)
            tasks.start("foresee", foresee)
            tasks.start("keep", keep)
            obey_all(context, monitors.axes, monitors.obey)
            with CLOCK.telling(monitors.move):
                await context.forever()
        finally:
            monitors.end()
