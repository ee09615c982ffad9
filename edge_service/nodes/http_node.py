"""Service state from all topics, and the HTTP interface that serves it."""

import asyncio
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from ..clock import CLOCK, now_ns
from ..health.axis_events import clock_changed
from ..health.condition import limits_of
from ..health.service_state import ServiceState
from ..health.store.events import StoredEvent
from ..health.store.history import MEMORY_MB, History
from ..health.store.outbox import Outbox
from ..health.store.store import StoreFailedError
from ..health.store.tokens import Tokens
from ..http_api.app import create_app
from ..http_api.guard import Authenticator, Caller, own_hosts
from ..http_api.jobs import Jobs
from ..http_api.recordings import Recordings
from ..http_api.routes.config import AxisConfigurations
from ..http_api.routes.history import answer_selector
from ..http_api.routes.service import Outputs
from ..http_api.routes.work import MotionAnswer
from ..http_api.serve import serve
from ..messages.answer import PreloadAnswer
from ..messages.codec import CodecError, Header
from ..messages.event import AxisCondition, Event
from ..messages.health import Command, ComponentStatus, Outcome
from ..messages.samples import SampleFrame
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, IMM, OUTCOME, PRELOAD, RAW, STATUS
from ..messages.trend import Stroke
from ..models.motions.registry import MOTIONS, MotionError, motion_limits
from ..models.screw.stroke_profile import stroke_profile
from ..recordings.reader import extent_of
from .component import Component
from .context import NodeContext, header
from .desks import AxisDesk, Scrape
from .health_node import alarm_settings
from .http_rights import server_files
from .output_node import send_test
from .record_node import DisagreementRecorder

MOST_TEMPORARY_MB = 500.0  # of recordings without a state folder: that may be memory
PERIOD_S = 1.0
"""Of what is written, read again and looked at."""
SAMPLES_PERIOD_S = 0.1  # of samples that recordings may need later: nobody waits for them
ANSWER_S = 5.0
"""So long a command may take."""
OWN_EVENTS = ("component_changed", "estimator_reset", "tested")
"""Kinds of events that components tell of themselves."""


class HttpNode:
    """State of the service, fed from the bus, and what the page asks of it. Raises ConfigError."""

    def __init__(self, context: NodeContext) -> None:
        config = context.config
        self._context, self._component = context, Component(context, "http")
        self._authenticator = Authenticator(Tokens(context.store), required=config.http.needs_token)
        folder = config.store.folder
        kept, budget_mb = "in memory only: it ends with the service", MEMORY_MB
        if folder is not None:
            budget_mb = config.store.budget_mb
            kept = f"on disk, up to {budget_mb:g} MB; the oldest estimates go first"
        self.state = ServiceState(
            {},
            now_ns(),
            events=context.events,
            history=History(context.store, budget_mb),
            kept=kept,
            place=config.keys,
            refused=context.bus.refused,
            configuration=config.digest,
        )
        store, there = context.store, context.outputs.items()
        self._outputs = Outputs(
            store,
            {
                name: [Outbox(store, output.queue(to), output.kinds) for to in output.receivers]
                for name, output in there
            },
            partial(send_test, config),
        )
        self._scrape = Scrape(context, self.state, self._outputs)
        self._machine_files: dict[str, Path] = {}
        for axis in context.machines:
            self._renew(axis)
        self._folder = folder or Path(tempfile.mkdtemp(prefix="edge-service-"))
        most_mb = MOST_TEMPORARY_MB if folder is None else config.store.budget_mb / 2.0
        self._recordings = Recordings(self._folder / "recordings", round(most_mb * 1e6), extent_of)
        service: tuple[str, ...] = ("--bus", context.bus.endpoint)
        service += () if config.file is None else (str(config.file),)
        jobs, files = self._folder / "jobs", self._machine_files
        self._jobs = Jobs(context.store, jobs, self._recordings, files, service)
        self._recorder = DisagreementRecorder(self._recordings.folder, self._tell_kept)
        context.renewals.append(self._renew)

    async def run(self) -> None:
        """Serve the API and the page. Raises AddressError before anything is served."""
        context, component, state = self._context, self._component, self.state
        preloads, samples = context.subscribe(PRELOAD), context.subscribe(RAW, depth=1024)
        component.readings = lambda: {"live_readers": float(len(state.readers))}
        component.counters = lambda: (
            preloads.counts() | context.events.counters() | {"lost_estimates": state.history.lost}
        )
        component.problems = lambda: [context.store.problem] if context.store.problem else []

        def take_event_of_service(_axis: str, _header: Header, event: Event) -> None:
            if event.kind in OWN_EVENTS:  # nothing else is theirs to tell
                self.take(event)

        def at(take: Callable[..., None], first: int = 0) -> Callable[..., None]:
            return lambda *heard: take(*heard[first:], now_ns())

        def take_samples(axis: str, _header: Header, frame: SampleFrame) -> None:
            self._recorder.follow(axis, frame)
            samples.rest(axis, SAMPLES_PERIOD_S)

        try:
            async with component.running():
                component.start(self._serve())
                component.follow(preloads, at(state.on_preload))
                component.follow(context.subscribe(IMM), at(state.on_opinion))
                component.follow(context.subscribe(HEALTH), at(state.on_health, 1))
                component.follow(context.subscribe(FEAT), state.on_feature)
                component.follow(context.subscribe_to_components(STATUS), at(state.on_component, 2))
                component.follow(context.subscribe(EVENT), lambda _, __, event: self.take(event))
                component.follow(context.subscribe_to_components(EVENT), take_event_of_service)
                component.follow(samples, take_samples)
                component.repeat(PERIOD_S, self._keep)
                component.start(context.dispatcher.watch(self.take))
                component.start(self._recorder.run())
                self._answer_history()
                with CLOCK.telling(lambda step_ns: self.take(clock_changed(step_ns, now_ns()))):
                    await context.forever()
        finally:
            await self._jobs.close()
            if context.config.store.folder is None:
                shutil.rmtree(self._folder, ignore_errors=True)
            with suppress(StoreFailedError):
                state.history.flush(now_ns() / 1e9)

    def take(self, event: Event) -> None:
        """Take an event in: it is told once it is kept."""

        def tell(kept: list[StoredEvent], _problem: str) -> None:
            for each in kept:
                self.state.readers.put_event(each)

        if self.state.concerns(event):
            self._context.dispatcher.put((event,), tell)
        self._recorder.note(event)

    def _renew(self, axis: str) -> None:
        """Show an axis by its new machine file, or no longer."""
        machine = self._context.machines.get(axis)
        if machine is None:
            self.state.drop(axis)
            del self._machine_files[axis]
            return
        limit = limits_of(alarm_settings(self._context.config, axis), machine.fresh_preload_percent)
        self.state.renew(axis, limit, machine.transmission_ratio_m_per_rad)
        self._machine_files |= {each.name: each.machine for each in self._context.config.axes}

    async def _serve(self) -> None:
        http, state = self._context.config.http, self.state
        tls = server_files(http)
        desk = AxisDesk(self._context, self._folder)

        def read_stroke(axis: str, preload: PreloadAnswer) -> Stroke | None:
            profile = stroke_profile(self._context.machines[axis])
            return None if profile is None else profile.told(preload)

        app = create_app(
            state,
            now_ns,
            own_hosts(http.url),
            send_command=self._send_command,
            jobs=self._jobs,
            recordings=self._recordings,
            motions=self._motions,
            outputs=self._outputs,
            metrics=self._scrape.text if self._scrape.output else None,
            authenticator=self._authenticator,
            note_change=self._note_change,
            configurations=AxisConfigurations(desk.read, desk.put, desk.remove),
            read_stroke=read_stroke,
        )

        def bound(host: str, port: int) -> None:
            self._component.to(ComponentStatus.OK)
            scheme, shown = "https" if tls else "http", f"[{host}]" if ":" in host else host
            self._context.on_http_ready(f"{scheme}://{shown}:{port}/")

        state.readers.open()
        end = state.readers.close
        await serve(app, http.host, http.port, tls=tls, on_bound=bound, before_stop=end)
        raise RuntimeError("the server of the page has ended")

    def _motions(self, axis: str) -> list[MotionAnswer]:
        """Motions that end by themselves, with their duration on an axis, or why it refuses."""
        limits, answers = motion_limits(self._context.machines[axis]), []
        for name, motion in MOTIONS.items():
            if motion.draw is not None:
                answer = MotionAnswer(name=name, purpose=motion.purpose)
                try:
                    plan = motion.plan(limits, clip=True)
                    known = {"duration_s": plan.duration_s, "left_out": plan.left_out}
                except MotionError as error:
                    known = {"refused": str(error)}
                answers.append(answer.model_copy(update=known))
        return answers

    async def _send_command(self, axis: str, command: Command) -> Outcome | None:
        """Outcome of a command, from whoever monitors the axis; None if nobody answers."""
        question = COMMAND.encode(axis, header(), command)
        key = self._context.config.keys.key(axis, OUTCOME)
        answer = await self._context.bus.ask(key, question, ANSWER_S)
        try:
            return None if answer is None else OUTCOME.decode(answer)[2]
        except CodecError:
            return None

    async def _tell_kept(self, axis: str, name: str) -> None:
        await self._send_command(axis, Command(action="recorded", user="edge-service", note=name))

    def _note_change(self, caller: Caller, action: str) -> None:
        who = caller.name or ""
        self.take(
            Event(
                axis="",
                kind="command",
                level=AxisCondition.NORMAL,
                text=f"{who or 'somebody'} ({caller.origin}): {action}",
                time_ns=now_ns(),
                who=who,
                origin=caller.origin,
            )
        )

    async def _keep(self) -> None:
        """Let tokens that were added or revoked count, and write what was heard."""
        run = self._context.store.run
        with suppress(StoreFailedError):  # its owner reports it; the known ones stay valid
            await run(self._authenticator.refresh, now_ns())
        with suppress(StoreFailedError):  # the watch of the store tells of it; it is tried again
            await run(self.state.history.flush, now_ns() / 1e9)

    def _answer_history(self) -> None:
        """Answer `.../{axis}/history?from=..;to=..;step=..` as HTTP does; its errors too."""
        root, at_work = self._context.config.keys.root, set[asyncio.Task[None]]()

        async def find(axis: str, selector: str, reply: Callable[[bytes | None], None]) -> None:
            run = self._context.store.run
            reply(await run(answer_selector, self.state, axis, selector, now_ns()))

        def answer(key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
            axis = key.removesuffix("/history").rpartition("/")[2]
            if axis not in self.state.axes or key != f"{root}/{axis}/history":
                reply(None)
                return
            task = asyncio.create_task(find(axis, question.decode(errors="replace"), reply))
            at_work.add(task)
            task.add_done_callback(at_work.discard)

        self._context.bus.answer(f"{root}/*/history", answer)
