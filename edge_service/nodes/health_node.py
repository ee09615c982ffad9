"""Estimates, features, reports and commands in; condition and events out: all axes."""

import logging
from collections.abc import Callable
from functools import partial

from ..clock import CLOCK, now_ns
from ..config import EdgeConfig
from ..config_tables import AlarmsConfig
from ..health.advice.announced import announced
from ..health.alarms.axis_alarms import AlarmSettings
from ..health.axis_events import refused_command, state_damaged
from ..health.axis_monitor import AxisFacts, AxisMonitor
from ..health.settings import HealthSettings
from ..health.store.events import StoredEvent, is_chatter
from ..health.store.states import DamagedStateError, State, load_state, set_state_aside
from ..health.trend.usage import ScrewGeometry
from ..messages.alarm import Command, Outcome
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentHealth, ComponentStatus
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, PRELOAD, STATUS
from ..models.machine import Machine
from .supervision.heartbeat import Heartbeat
from .wiring.commands import obey_all
from .wiring.context import NodeContext, Reporter
from .wiring.event_dispatcher import EventDispatcher
from .wiring.stages import load_machines

log = logging.getLogger(__name__)
STATE = "monitor"
"""Name of the states in the store."""
HEALTH_PERIOD_S = 1.0
SAVE_PERIOD_S = 10.0


def health_settings(config: EdgeConfig, axis: str) -> HealthSettings:
    """Settings of the condition of an axis from the configuration."""
    warning, fault = config.limits_percent(axis)
    return HealthSettings(warning_below_percent=warning, fault_below_percent=fault)


def alarm_settings(config: AlarmsConfig) -> AlarmSettings:
    """The alarms' settings from the configuration."""
    return AlarmSettings(**config.model_dump(exclude={"warning_percent", "fault_percent"}))


def axis_facts(axis: str, machine: Machine) -> AxisFacts:
    """Facts that the monitor of an axis needs of its machine file."""
    geometry = ScrewGeometry(machine.transmission_ratio_m_per_rad, machine.axis.stroke_m)
    return AxisFacts(axis, machine.fresh_preload_percent, geometry)


class Monitors:
    """Monitors of all axes: what they say is kept, then published."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._events, self._store = context.events, context.store
        self._config = config
        self._machines = load_machines(config)
        self.axes: dict[str, AxisMonitor] = {}
        self.damaged = 0
        """States that were none."""
        self._health = {axis: context.publisher(axis, HEALTH) for axis in self._machines}
        self._event = {axis: context.publisher(axis, EVENT) for axis in self._machines}
        self.dispatcher = EventDispatcher(context.events)

    def load(self) -> None:
        """Go on where the last process was. Raises StoreFailedError."""
        self.axes = {axis: self._loaded(axis) for axis in self._machines}

    def _loaded(self, axis: str) -> AxisMonitor:
        """Monitor of an axis as it was, or a new one: then a damaged state is set aside."""
        begun_ns = now_ns()
        make = partial(
            AxisMonitor,
            axis_facts(axis, self._machines[axis]),
            health_settings(self._config, axis),
            alarm_settings(self._config.alarms),
            begun_ns,
        )
        monitor = make()
        try:
            document = load_state(self._store, STATE, axis)
            if document is not None:
                monitor.restore(document)
            return monitor
        except (DamagedStateError, ValueError, RecursionError) as error:
            aside = set_state_aside(self._store, STATE, axis)
            words = f"alarms, trend and use start over: {error}; their state is kept as {aside}"
            log.warning("axis %s: %s", axis, words)
            self.damaged += 1
            self._events.put((state_damaged(axis, words, begun_ns),), begun_ns)
        return make()

    def problems(self) -> list[str]:
        """Reason for which nothing is kept of what is said; empty if it is."""
        return [self._store.problem] if self._store.problem else []

    def keep(self) -> None:
        """Keep the state of every axis."""
        for axis in self.axes:
            self._announce(axis, (), keeps=True)

    def end(self) -> None:
        """Keep all that must outlive the process, now."""
        self.keep()
        self.dispatcher.flush()

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
        known = monitor.answered(command)
        outcome, events = (known, ()) if known else monitor.obey(command, at_ns)

        def tell(problem: str) -> None:
            message = problem or outcome.message
            told(outcome.model_copy(update={"kept": not problem, "message": message}))

        if not (known or outcome.accepted):
            events = (refused_command(axis, command, outcome.message, at_ns),)
        self._announce(axis, events, tell, keeps=bool(command.key))

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
        told: Callable[[str], None] = lambda _problem: None,
        *,
        keeps: bool = False,
    ) -> None:
        """Publish events and condition once they are kept with the state of the axis."""
        monitor = self.axes[axis]
        health = monitor.health(now_ns())
        events = announced(events, health)
        states: tuple[State, ...] = ()
        if keeps or any(not is_chatter(event.kind) for event in events):
            states = (State.of(STATE, axis, monitor.snapshot()),)

        def publish(kept: list[StoredEvent], problem: str) -> None:
            for each in kept:
                self._event[axis].publish(each.event, each.event.time_ns)
            self._health[axis].publish(health, now_ns())
            told(problem)

        self.dispatcher.put(events, publish, states)


async def run(context: NodeContext) -> None:
    """Monitor every configured axis until cancelled."""
    monitors = Monitors(context)
    preloads, features = context.subscribe(PRELOAD), context.subscribe(FEAT)
    reports = context.subscribe_to_components(STATUS)
    commands = context.subscribe(COMMAND)
    reporter = Reporter(context, "health")
    reporter.counters = lambda: preloads.counts() | {"damaged_states": monitors.damaged}
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
            await heart.sleep(SAVE_PERIOD_S)
            monitors.keep()

    async with reporter.running() as tasks:
        await context.from_store(reporter, monitors.load)
        reporter.to(ComponentStatus.OK)
        try:
            tasks.start("events", monitors.dispatcher.run, vital=True)
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
