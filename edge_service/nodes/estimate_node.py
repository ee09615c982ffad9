"""Feature blocks in, preload estimates out: all axes."""

import asyncio
import logging
from functools import partial

from ..bus.subscriber import Subscriber
from ..clock import CLOCK, now_ns
from ..health.store.store import DamagedStateError, State, load_state, set_state_aside
from ..messages.answer import of_fresh
from ..messages.codec import Header
from ..messages.estimate import ImmEstimate, PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, Statement, told
from ..messages.features import FeatureBlock
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import EVENT, FEAT, IMM, PRELOAD, RAW
from ..threads import Threads
from .component import Component, said
from .context import NodeContext
from .estimated_axis import EstimatedAxis, Kept, StateError, identity_of
from .record_node import Shaking, notch_in
from .stages import PREPARING, THESIS_METHOD, make_beside, make_estimator, warm_up

log = logging.getLogger(__name__)
PART_REPLACED = "part_replaced"
STATE = "estimate"
"""Name of the states in the store."""
SAMPLES_PERIOD_S = 0.2
_OF_BOTH = ImmEstimate.model_fields.keys() & PreloadEstimate.model_fields.keys()
SAVE_PERIOD_S = 60.0
"""Longest time that a crash may cost, s; a state is some 300 kB, and disks wear."""


class Estimators:
    """The estimators of all axes, their states in the store, and their tests by shaking.

    Attributes:
        damaged: states that were none.
        problem: reason for which a state cannot be kept now; empty if it can.
    """

    def __init__(self, context: NodeContext) -> None:
        self._context, self.component = context, Component(context, "estimate")
        self.parts: dict[str, Component] = {}
        self.axes: dict[str, EstimatedAxis] = {}
        self._beside: dict[str, EstimatedAxis] = {}
        self._preloads, self._opinions = context.publishers(PRELOAD), context.publishers(IMM)
        self._identities: dict[str, str] = {}
        self._looked: dict[str, tuple[Shaking, Subscriber[SampleFrame]]] = {}
        for axis in context.machines:
            self.add(axis)
        self.damaged, self.problem = 0, ""
        self.component.problems = lambda: [self.problem] if self.problem else []

    def add(self, name: str) -> Component:
        """Begin with an axis; returns the part that reports on it."""
        part, config = Component(self._context, "estimate", name), self._context.config.estimator
        axis = EstimatedAxis(
            name,
            lambda: make_estimator(config, self._context.machines[name]),
            partial(part.note, "the estimator fails"),
            lambda why: part.tell("estimator_reset", told(Code.ESTIMATE_ANEW, {"reason": why})),
        )
        part.problems = lambda: [axis.problem] if axis.problem else []
        part.is_broken = lambda: bool(axis.problem)
        beside = EstimatedAxis(
            *(name, lambda: make_beside(config, self._context.machines[name]), said),
            lambda _why: None,
        )
        part.counters = lambda: {"resets": axis.resets, "imm_failures": beside.failed}
        self.parts[name], self.axes[name], self._beside[name] = part, axis, beside
        self._identities[name] = identity_of(self._context.machines[name], config)
        return part

    def take(self, axis: str, header: Header, block: FeatureBlock) -> None:
        """Tell what an interval says, then the second opinion: its own where it is the thesis'."""
        if axis not in self.axes:
            return
        time_ns, estimate = header.source_time_ns, self.axes[axis].take(header, block)
        self._preloads[axis].publish(estimate, time_ns)
        self.watch(axis, block)
        if estimate.method != THESIS_METHOD:
            estimate = self._beside[axis].take(header, block)
        told = {name: getattr(estimate, name) for name in _OF_BOTH}
        engine = self._context.config.estimator.engine
        opinion = ImmEstimate(axis=axis, engine=engine, measured_time_ns=time_ns, **told)
        self._opinions[axis].publish(opinion, time_ns)

    def load(self) -> None:
        """Go on where the last process was. Raises StoreFailedError."""
        store = self._context.store
        for name, axis in self.axes.items() if self._context.keeps_estimates else ():
            try:
                document = load_state(store, STATE, name)
                if document is not None:
                    replaced = self._context.events.page(1, name, (PART_REPLACED,))
                    replaced_ns = replaced[0].event.time_ns if replaced else 0
                    kept = Kept.of(document, name, self._identities[name])
                    axis.load(kept.as_of(now_ns(), replaced_ns))
            except (StateError, DamagedStateError) as error:
                aside = ""
                if isinstance(error, DamagedStateError) or error.damaged:
                    self.damaged += 1
                    aside = f"; the damaged state is kept as {set_state_aside(store, STATE, name)}"
                log.warning("axis %s: its estimate starts over: %s%s", name, error, aside)

    def keep(self) -> None:
        """Let the state of every axis that has gone on wait for the disk; never waits itself."""
        self.problem = ""
        for name, axis in self.axes.items() if self._context.keeps_estimates else ():
            kept = axis.to_keep()
            if kept is not None:
                try:
                    state = State.of(STATE, name, kept.document(name, self._identities[name]))
                    self._context.dispatcher.put((), lambda *_: None, (state,))
                except ValueError as error:
                    self.problem = f"axis {name}: the state of the estimator is none ({error})"

    def forget(self, axis: str) -> None:
        """Begin anew: the part is another."""
        for each in (self.axes[axis], self._beside[axis]):
            each.forget()
        self._context.dispatcher.put((), lambda *_: None, (State(STATE, axis, None),))
        self.look(axis)

    def renew(self, axis: str) -> None:
        """Begin an axis anew, unless its estimate rests on what it rested on before."""
        identity = identity_of(self._context.machines[axis], self._context.config.estimator)
        if identity != self._identities[axis]:
            self._identities[axis] = identity
            self.forget(axis)

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        for axis in (*self.axes.values(), *self._beside.values()):
            axis.move(step_ns)

    def look(self, axis: str) -> None:
        """Look for tests of an axis from now on, if it is there, takes any, and lives."""
        if axis in self._looked:
            self._looked.pop(axis)[1].close()
        machine = self._context.machines.get(axis)
        learned = None if machine is None else machine.commissioned
        if learned is None or learned.notch is None or self._context.is_replay:
            return
        key = self._context.config.keys.key(axis, RAW)
        samples = self._context.bus.subscribe(key, RAW, depth=1024, keys=(key,))
        shaking = Shaking(learned.notch.feed_rad_s, learned.coulomb_nm)
        self._looked[axis] = shaking, samples

        def follow(axis: str, _header: Header, frame: SampleFrame) -> None:
            shaking.samples.push(frame)
            samples.rest(axis, SAMPLES_PERIOD_S)

        self.component.follow(samples, follow)

    def watch(self, axis: str, block: FeatureBlock) -> None:
        """Look whether an interval ends a test, and read that."""
        frames = self._looked[axis][0].over(block) if axis in self._looked else []
        if frames:
            self.component.start(self._read(axis, frames))

    async def _read(self, axis: str, frames: list[SampleFrame]) -> None:
        looked, level = self._looked.get(axis), AxisCondition.WARNING
        with self.component.bears(f"a test of axis {axis}"):
            try:
                seen = await notch_in(frames)
                if seen is None or looked is not self._looked.get(axis):
                    return  # no test, or one of a part or machine file of before
                estimate = self.axes[axis].take_test(seen)
                share = of_fresh(estimate, self._context.machines[axis].fresh_preload_percent)
                said = Statement() if share is None else told(Code.TESTED, **dict(share))
                if estimate.reasons:
                    said = Statement(text=f"{said.text} {estimate.reasons[0]}.")
                else:
                    level = AxisCondition.NORMAL
                self.keep()
            except ValueError as error:
                said = Statement(text=f"The test by shaking says nothing: {error}.")
            self.parts[axis].tell("tested", said, level)


async def run(context: NodeContext) -> None:
    """Estimate every configured axis until cancelled."""
    estimators = Estimators(context)
    axes, component = estimators.axes, estimators.component
    features, work = context.subscribe(FEAT, depth=1024), Threads("estimate")
    component.counters = lambda: features.counts() | {"damaged_states": estimators.damaged}

    def take_event(axis: str, _header: Header, event: Event) -> None:
        if axis in axes and event.kind == PART_REPLACED:
            estimators.forget(axis)

    later: dict[str, asyncio.Task[None]] = {}

    async def live(part: Component) -> None:
        async with part.running():
            await context.forever()

    async def begin(axis: str) -> None:
        """Estimate an axis that came later; until the estimator is warm, nothing is taken in."""
        await work.run(warm_up, context.config.estimator, (context.machines[axis],))
        part = estimators.add(axis)
        part.to(ComponentStatus.OK)
        await live(part)

    def renew(axis: str) -> None:
        estimators.look(axis)
        if axis not in context.machines:
            axes.pop(axis, None)
            if axis in later:
                later.pop(axis).cancel()
        elif axis in axes:
            estimators.renew(axis)
        elif axis not in later:
            later[axis] = component.start(begin(axis))

    async with component.running():
        parts = (component, *estimators.parts.values())
        for part in parts:
            part.to(ComponentStatus.STARTING, PREPARING)
        later |= {axis: component.start(live(part)) for axis, part in estimators.parts.items()}
        await context.prepared
        await component.from_store(estimators.load)
        for part in parts:
            part.to(ComponentStatus.OK)
        context.renewals.append(renew)
        for axis in {*context.machines, *axes}:  # what has changed while all was being prepared
            renew(axis)
        component.follow(features, estimators.take)
        component.follow(context.subscribe(EVENT), take_event)
        component.repeat(SAVE_PERIOD_S, estimators.keep)
        try:
            with CLOCK.telling(estimators.move):
                await context.forever()
        finally:
            estimators.keep()
