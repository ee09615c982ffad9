"""Estimates, features, reports and commands in; condition and events out: all axes."""

import logging
from collections.abc import Callable

from ..bus.questions import Answering
from ..clock import CLOCK, now_ns
from ..config import EdgeConfig
from ..config_tables import AlarmsConfig
from ..health.axis_events import refused_command
from ..health.axis_monitor import AxisMonitor
from ..health.store.events import StoredEvent, is_chatter
from ..health.store.store import DamagedStateError, State, load_state, set_state_aside
from ..health.wear.usage import ScrewGeometry
from ..messages.codec import CodecError, Header
from ..messages.estimate import PreloadEstimate
from ..messages.event import AxisCondition, Event
from ..messages.features import FeatureBlock
from ..messages.health import Command, ComponentHealth, ComponentStatus, Outcome
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, OUTCOME, PRELOAD, STATUS
from ..threads import Threads
from .component import Component
from .context import NodeContext, header

log = logging.getLogger(__name__)
STATE = "monitor"
"""Name of the states in the store."""
HEALTH_PERIOD_S = 1.0
SAVE_PERIOD_S = 10.0


def alarm_settings(config: EdgeConfig, axis: str) -> AlarmsConfig:
    warning, fault = config.limits_percent(axis)
    return config.alarms.model_copy(update={"warning_percent": warning, "fault_percent": fault})


class Monitors:
    """Monitors of all axes: what they say is kept, then published."""

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        self.axes: dict[str, AxisMonitor] = {}
        self._gone: dict[str, AxisMonitor] = {}
        """Of axes that were removed: if they come back, they go on where they were."""
        self.damaged = 0
        """States that were none."""
        self._health, self._event = context.publishers(HEALTH), context.publishers(EVENT)
        self._threads = Threads("trend")
        context.renewals.append(self.renew)

    def load(self) -> None:
        """Go on where the last process was. Raises StoreFailedError."""
        self.axes = {axis: self._loaded(axis) for axis in (*self._context.machines,)}

    def renew(self, axis: str) -> None:
        """Go on with an axis by its new machine file, begin with a new one, or forget it."""
        before = self.axes.pop(axis, None) or self._gone.pop(axis, None)
        if axis in self._context.machines:
            self.axes[axis] = self._made(axis)
            if before is not None:
                self.axes[axis].restore(before.snapshot())
        elif before is not None:
            self._gone[axis] = before

    def _made(self, axis: str) -> AxisMonitor:
        config, machine = self._context.config, self._context.machines[axis]
        geometry = ScrewGeometry(machine.transmission_ratio_m_per_rad, machine.axis.stroke_m)
        settings = alarm_settings(config, axis)
        return AxisMonitor(axis, machine.fresh_preload_percent, geometry, settings, now_ns())

    def _loaded(self, axis: str) -> AxisMonitor:
        """Monitor of an axis as it was, or a new one: then a damaged state is set aside."""
        store, monitor = self._context.store, self._made(axis)
        try:
            document = load_state(store, STATE, axis)
            if document is not None:
                monitor.restore(document)
            return monitor
        except (DamagedStateError, ValueError, RecursionError) as error:
            aside, at_ns = set_state_aside(store, STATE, axis), now_ns()
            words = f"alarms, trend and use start over: {error}; their state is kept as {aside}"
            log.warning("axis %s: %s", axis, words)
            self.damaged += 1
            level = AxisCondition.WARNING
            damaged = Event(axis=axis, kind="store_damaged", level=level, text=words, time_ns=at_ns)
            self._context.events.put((damaged,), at_ns)
        return self._made(axis)

    def keep(self, axis: str) -> None:
        self._announce(axis, (), at_once=True, keeps=True)

    def take_preload(self, axis: str, header: Header, estimate: PreloadEstimate) -> None:
        if axis in self.axes:
            self._announce(axis, self.axes[axis].on_preload(header, estimate, now_ns()))

    def take_features(self, axis: str, header: Header, block: FeatureBlock) -> None:
        if axis in self.axes:
            self._announce(axis, self.axes[axis].on_feature(header, block, now_ns()))

    def take_report(self, axis: str, _header: Header, report: ComponentHealth) -> None:
        """Take the report in of a component of one axis, or of all axes."""
        for each in self.axes if report.axis is None else (axis,):
            if each in self.axes:
                self._announce(each, self.axes[each].on_component(report, now_ns()))

    def serve_commands(self) -> Answering:
        """Answer the commands that are asked on the bus by what came of them, once it is kept."""
        keys = self._context.config.keys

        def answer(key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
            try:
                axis, _, command = COMMAND.decode(question)
            except CodecError:
                axis = ""
            if axis not in self.axes or key != keys.key(axis, OUTCOME):
                reply(None)
                return
            self.serve(axis, command, lambda told: reply(OUTCOME.encode(axis, header(), told)))

        return self._context.bus.answer(keys.all_axes(OUTCOME), answer)

    def serve(self, axis: str, command: Command, told: Callable[[Outcome], None]) -> None:
        """Do what is asked of an axis; the outcome is told once it is kept."""
        at_ns, monitor = now_ns(), self.axes[axis]
        known = monitor.answered(command)
        outcome, events = (known, ()) if known else monitor.obey(command, at_ns)

        def tell(problem: str) -> None:
            message = problem or outcome.message
            told(outcome.model_copy(update={"kept": not problem, "message": message}))

        if not (known or outcome.accepted):
            events = (refused_command(axis, command, outcome.message, at_ns),)
        self._announce(axis, events, tell, at_once=True, keeps=bool(command.key))

    def tick(self, axis: str) -> None:
        """Let time pass on an axis, and announce its condition."""
        self._announce(axis, self.axes[axis].tick(now_ns()), at_once=True)

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns: each monitor begins anew from its state."""
        for axis, before in self.axes.items():
            self.axes[axis] = self._made(axis)
            self.axes[axis].restore(before.snapshot(), step_ns)

    async def foresee(self, axis: str) -> None:
        """Make an axis' trend, if it is due."""
        monitor = self.axes.get(axis)
        if monitor is not None and monitor.trend_is_due(now_ns()):
            trend = await self._threads.run(monitor.trend_work())
            monitor.take_trend(trend, now_ns())

    def _announce(
        self,
        axis: str,
        events: tuple[Event, ...],
        told: Callable[[str], None] = lambda _problem: None,
        *,
        at_once: bool = False,
        keeps: bool = False,
    ) -> None:
        """Publish events and condition once they are kept, with the state that they led to."""
        if not (events or at_once):
            return
        monitor = self.axes[axis]
        health = monitor.health(now_ns())
        keeps |= any(not is_chatter(event.kind) for event in events)
        states = (State.of(STATE, axis, monitor.snapshot()),) if keeps else ()

        def publish(kept: list[StoredEvent], problem: str) -> None:
            if axis not in self._context.gone:
                for each in kept:
                    self._event[axis].publish(each.event, each.event.time_ns)
                self._health[axis].publish(health, now_ns())
            told(problem)

        self._context.dispatcher.put(events, publish, states)


async def run(context: NodeContext) -> None:
    """Monitor every configured axis until cancelled."""
    monitors = Monitors(context)
    preloads, features = context.subscribe(PRELOAD), context.subscribe(FEAT)
    component = Component(context, "health")
    component.counters = lambda: preloads.counts() | {"damaged_states": monitors.damaged}
    component.problems = lambda: [context.store.problem] if context.store.problem else []

    def of_all(what: str, work: Callable[[str], None]) -> Callable[[], None]:
        """Work on every axis, of which one may fail alone."""

        def each() -> None:
            for axis in monitors.axes:
                with component.bears(f"the {what} of axis {axis}"):
                    work(axis)

        return each

    async def foresee() -> None:
        for axis in (*monitors.axes,):
            with component.bears(f"the trend of axis {axis}"):
                await monitors.foresee(axis)

    keep = of_all("state", monitors.keep)
    async with component.running():
        await component.from_store(monitors.load)
        for axis in {*monitors.axes} ^ {*context.machines}:  # what came or went meanwhile
            monitors.renew(axis)
        component.to(ComponentStatus.OK)
        component.follow(preloads, monitors.take_preload)
        component.follow(features, monitors.take_features)
        component.follow(context.subscribe_to_components(STATUS), monitors.take_report)
        component.repeat(HEALTH_PERIOD_S, of_all("time", monitors.tick))
        component.repeat(HEALTH_PERIOD_S, foresee)
        component.repeat(SAVE_PERIOD_S, keep)
        monitors.serve_commands()
        try:
            with CLOCK.telling(monitors.move):
                await context.forever()
        finally:
            keep()
