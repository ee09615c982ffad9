"""Feature blocks in, preload estimates out: all axes."""

import logging
from contextlib import AsyncExitStack
from functools import partial

from ..clock import CLOCK
from ..messages.event import Event
from ..messages.features import FeatureBlock
from ..messages.header import Header
from ..messages.health import ComponentStatus
from ..messages.topics import EVENT, FEAT, PRELOAD
from .stores.estimate_store import EstimateStore, Kept, identity_of
from .supervision.heartbeat import Heartbeat
from .supervision.task import TaskChange
from .wiring.context import NodeContext, Reporter
from .wiring.guarded_axis import GuardedAxis
from .wiring.stages import WARM_UP_S, load_machines, make_estimator, warm_up

log = logging.getLogger(__name__)
PREPARING = "the estimator is being prepared; after an installation or upgrade that takes a minute"
PART_REPLACED = "part_replaced"
RETRY_PERIOD_S = 2.0
SAVE_PERIOD_S = 60.0
"""Longest time that a crash may cost, s; a state is some 300 kB, and disks wear."""


class _Axes:
    """The estimators of all axes, and where their state is kept."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._context = context
        self.machines = load_machines(config)
        self.parts = {axis: Reporter(context, "estimate", axis) for axis in self.machines}
        self.axes = {axis: self._guarded(axis) for axis in self.machines}
        identities = {
            axis: identity_of(machine, config.estimator) for axis, machine in self.machines.items()
        }
        folder = config.history.folder if context.keeps_estimates else None
        self._store = None if folder is None else EstimateStore(folder, identities)
        self._unwritten: dict[str, Kept] = {}
        self.problem = ""
        """Reason for which states cannot be kept now; empty if they are."""

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
        """Go on where the last process was."""
        if self._store is not None:
            for name, axis in self.axes.items():
                replaced = self._context.diary.diary.newest(name, PART_REPLACED)
                axis.load(self._store, 0 if replaced is None else replaced.event.time_ns)

    def to_keep(self) -> dict[str, Kept]:
        """State of every axis that has gone on; only in the thread of the event loop."""
        if self._store is None:
            return {}
        kept = {name: axis.to_keep() for name, axis in self.axes.items()}
        return {name: each for name, each in kept.items() if each is not None}

    def write(self, kept: dict[str, Kept]) -> None:
        """Write states, from any thread; what a full disk does not take is tried again."""
        if self._store is None:
            return
        self._unwritten |= kept
        problem = ""
        for axis, each in tuple(self._unwritten.items()):
            try:
                self._store.save({axis: each})
                self._unwritten.pop(axis, None)
            except (OSError, ValueError) as error:
                problem = f"the state of the estimator cannot be saved (axis {axis}: {error})"
        if problem and not self.problem:
            log.warning("%s", problem)
        self.problem = problem

    def damaged_files(self) -> int:
        """Files that were set aside."""
        return 0 if self._store is None else self._store.damaged_files

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        for axis in self.axes.values():
            axis.move(step_ns)

    def forget(self, axis: str) -> None:
        """Begin anew: the part is another."""
        taken = self.axes[axis].forget()
        self._unwritten.pop(axis, None)
        try:
            if self._store is not None:
                self._store.forget(axis, taken)
        except OSError as error:
            log.warning("the state of axis %s cannot be removed (%s)", axis, error)


async def run(context: NodeContext) -> None:
    """Estimate every configured axis until cancelled."""
    config = context.config
    estimated = _Axes(context)
    axes = estimated.axes
    publishers = {axis: context.publisher(axis, PRELOAD) for axis in axes}
    features = context.subscribe(FEAT, depth=1024)
    events = context.subscribe(EVENT)
    reporter = Reporter(context, "estimate")
    reporter.counters = lambda: features.counts() | {"damaged_files": estimated.damaged_files()}
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
            await heart.sleep(RETRY_PERIOD_S if estimated.problem else SAVE_PERIOD_S)
            await heart.in_thread(estimated.write, estimated.to_keep())

    async with AsyncExitStack() as parts, reporter.running() as tasks:
        for part in estimated.parts.values():
            await parts.enter_async_context(part.running())
        for each in (reporter, *estimated.parts.values()):
            each.to(ComponentStatus.STARTING, PREPARING)
        machines = estimated.machines.values()
        await context.heart.in_thread(
            warm_up, config.downsample, config.estimator, machines, limit_s=WARM_UP_S
        )
        estimated.load()
        for each in (reporter, *estimated.parts.values()):
            each.to(ComponentStatus.OK)
        try:
            tasks.follow("features", features, take_features, vital=True)
            tasks.follow("events", events, take_event)
            tasks.start("keep", keep)
            with CLOCK.telling(estimated.move):
                await context.forever()
        finally:
            estimated.write(estimated.to_keep())
