"""Feature blocks in, preload estimates out: all axes."""

import logging
from contextlib import AsyncExitStack
from functools import partial

from ..clock import CLOCK, now_ns
from ..health.store.states import DamagedStateError, State, load_state, set_state_aside
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentStatus
from ..messages.topics import EVENT, FEAT, PRELOAD
from .supervision.heartbeat import Heartbeat
from .supervision.task import TaskChange
from .wiring.context import NodeContext, Reporter
from .wiring.estimate_state import Kept, StateError, identity_of
from .wiring.event_dispatcher import try_to_save
from .wiring.guarded_axis import GuardedAxis
from .wiring.stages import WARM_UP_S, load_machines, make_estimator, warm_up

log = logging.getLogger(__name__)
PREPARING = "the estimator is being prepared; after an installation or upgrade that takes a minute"
PART_REPLACED = "part_replaced"
STATE = "estimate"
"""Name of the states in the store."""
SAVE_PERIOD_S = 60.0
"""Longest time that a crash may cost, s; a state is some 300 kB, and disks wear."""


class Estimators:
    """The estimators of all axes, and their states in the store."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._context = context
        self.machines = load_machines(config)
        self.parts = {axis: Reporter(context, "estimate", axis) for axis in self.machines}
        self.axes = {axis: self._guarded(axis) for axis in self.machines}
        self._identities = {
            axis: identity_of(machine, config.estimator) for axis, machine in self.machines.items()
        }
        self.damaged = 0
        """States that were none."""
        self.problem = ""
        """Reason for which a state cannot be kept now; empty if it can."""

    def _guarded(self, name: str) -> GuardedAxis:
        part = self.parts[name]
        make = partial(make_estimator, self._context.config.estimator, self.machines[name])

        def tell_reset(reason: str) -> None:
            part.tell(TaskChange("estimator_reset", "estimator", reason, axis.resets))

        axis = GuardedAxis(name, make, partial(part.note, "estimator"), tell_reset)
        part.problems = lambda: [axis.problem] if axis.problem else []
        part.broken = lambda: bool(axis.problem)
        part.counters = lambda: {"resets": axis.resets}
        return axis

    def load(self) -> None:
        """Go on where the last process was. Raises StoreFailedError."""
        if not self._context.keeps_estimates:
            return
        for name, axis in self.axes.items():
            try:
                kept = self._kept(name)
                if kept is not None:
                    axis.load(kept)
            except StateError as error:
                aside = ""
                if error.damaged:
                    self.damaged += 1
                    aside = f", kept as {set_state_aside(self._context.store, STATE, name)}"
                log.warning("axis %s: its estimate starts over: %s%s", name, error, aside)

    def _kept(self, name: str) -> Kept | None:
        try:
            document = load_state(self._context.store, STATE, name)
        except DamagedStateError as error:
            raise StateError(f"its state is damaged ({error})", damaged=True) from None
        if document is None:
            return None
        replaced = self._context.events.newest(name, PART_REPLACED)
        replaced_ns = 0 if replaced is None else replaced.event.time_ns
        return Kept.of(document, name, self._identities[name]).as_of(now_ns(), replaced_ns)

    def keep(self) -> None:
        """Let the state of every axis that has gone on wait for the disk; never waits itself."""
        self.problem = ""
        for name, axis in self.axes.items() if self._context.keeps_estimates else ():
            kept = axis.to_keep()
            if kept is not None:
                try:
                    state = State.of(STATE, name, kept.document(name, self._identities[name]))
                    self._context.events.put((), now_ns(), (state,))
                except ValueError as error:
                    self.problem = f"axis {name}: the state of the estimator is none ({error})"

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        for axis in self.axes.values():
            axis.move(step_ns)

    def forget(self, axis: str) -> None:
        """Begin anew: the part is another."""
        self.axes[axis].forget()
        self._context.events.put((), now_ns(), (State(STATE, axis, None),))


async def run(context: NodeContext) -> None:
    """Estimate every configured axis until cancelled."""
    config = context.config
    estimated = Estimators(context)
    axes = estimated.axes
    publishers = {axis: context.publisher(axis, PRELOAD) for axis in axes}
    features = context.subscribe(FEAT, depth=1024)
    events = context.subscribe(EVENT)
    reporter = Reporter(context, "estimate")
    reporter.counters = lambda: features.counts() | {"damaged_states": estimated.damaged}
    reporter.problems = lambda: [estimated.problem] if estimated.problem else []

    def take_features(axis: str, header: Header, block: FeatureBlock) -> None:
        if axis in axes:
            estimate = axes[axis].take(header, block)
            publishers[axis].publish(estimate, header.source_time_ns)

    def take_event(axis: str, _header: Header, event: Event) -> None:
        if axis in axes and event.kind == PART_REPLACED:
            estimated.forget(axis)

    async def keep(heart: Heartbeat) -> None:
        while True:
            await heart.sleep(SAVE_PERIOD_S)
            estimated.keep()
            await heart.in_thread(try_to_save, context.events)

    async with AsyncExitStack() as parts, reporter.running() as tasks:
        for part in estimated.parts.values():
            await parts.enter_async_context(part.running())
        for each in (reporter, *estimated.parts.values()):
            each.to(ComponentStatus.STARTING, PREPARING)
        machines = estimated.machines.values()
        await context.heart.in_thread(warm_up, config.estimator, machines, limit_s=WARM_UP_S)
        await context.from_store(reporter, estimated.load)
        for each in (reporter, *estimated.parts.values()):
            each.to(ComponentStatus.OK)
        try:
            tasks.follow("features", features, take_features, vital=True)
            tasks.follow("events", events, take_event)
            tasks.start("keep", keep)
            with CLOCK.telling(estimated.move):
                await context.forever()
        finally:
            estimated.keep()
            try_to_save(context.events)
