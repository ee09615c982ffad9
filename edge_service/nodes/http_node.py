"""Service state from all topics, and the HTTP interface that serves it."""

import asyncio
import logging
import shutil
import tempfile
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from ..clock import CLOCK, now_ns
from ..config import EdgeConfig
from ..health.axis_events import clock_changed
from ..health.condition.refusal_watch import RefusalWatch
from ..health.service_state import ServiceState
from ..health.settings import AxisLimits
from ..health.state_settings import Keeping
from ..health.store.events import StoredEvent
from ..health.store.history import MEMORY_MB, History
from ..health.store.store import StoreFailedError
from ..health.store.tokens import Tokens
from ..http_api.access import Authenticator, Caller
from ..http_api.app import create_app
from ..http_api.guard import own_hosts
from ..http_api.jobs import Jobs
from ..http_api.recordings import Recordings
from ..http_api.routes.motions import MotionAnswer
from ..http_api.serve import serve
from ..messages.alarm import Command
from ..messages.estimate import PreloadEstimate
from ..messages.event import Event, Severity
from ..messages.header import Header
from ..messages.health import AxisHealth, ComponentHealth, ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import COMMAND, EVENT, FEAT, HEALTH, PRELOAD, RAW, STATUS
from ..models.machine import Machine
from ..models.motions.registry import MOTIONS, MotionError, motion_limits
from ..models.screw.stroke_profile import stroke_profile
from .health_node import health_settings
from .outputs.desk import Scrape, StoreOutputDesk
from .stores.disagreement_recorder import DisagreementRecorder
from .supervision.heartbeat import Heartbeat
from .supervision.task import Work
from .supervision.tasks import Tasks
from .wiring.commands import give
from .wiring.context import OWN_EVENTS, NodeContext, Reporter
from .wiring.event_dispatcher import EventDispatcher
from .wiring.history_queries import answer_history
from .wiring.http_rights import Address, needs_token, server_files
from .wiring.stages import load_machines

log = logging.getLogger(__name__)
REFUSALS_PERIOD_S = FLUSH_PERIOD_S = TOKENS_PERIOD_S = 1.0
_FLUSH_LIMIT_S = 60.0
MOST_TEMPORARY_MB = 500.0  # of recordings without a state folder: that may be memory
SAMPLES_PERIOD_S = 0.1  # of samples that recordings may need later: nobody waits for them


def _limits(context: NodeContext) -> dict[str, AxisLimits | None]:
    return {
        axis: health_settings(context.config, axis).limits(machine.fresh_preload_percent)
        for axis, machine in load_machines(context.config).items()
    }


async def run(context: NodeContext) -> None:
    """Serve the API and the page until cancelled.

    Raises AddressError and ConfigError before anything is served.
    """
    config = context.config
    http, machines, folder = config.http, load_machines(config), config.store.folder
    authenticator = Authenticator(Tokens(context.store), required=needs_token(http))
    tls = server_files("http", http.certificate, http.private_key)
    history = History(context.store, MEMORY_MB if folder is None else config.store.budget_mb)
    keeping = Keeping(
        history=history,
        events=context.events,
        ratios_m_per_rad={
            axis: machine.transmission_ratio_m_per_rad for axis, machine in machines.items()
        },
        place=_place(config),
    )
    state = ServiceState(
        _limits(context),
        now_ns(),
        keeping=keeping,
        strokes={axis: stroke_profile(machine) for axis, machine in machines.items()},
        place=config.keys,
        refused=context.bus.refused,
        configuration=config.digest,
    )
    outputs = StoreOutputDesk(config, context.store)
    scrape = Scrape(context, state, outputs)
    machine_files = {axis.name: axis.machine for axis in config.axes}
    root = folder or Path(tempfile.mkdtemp(prefix="edge-service-"))
    most_mb = MOST_TEMPORARY_MB if folder is None else config.store.budget_mb / 2.0
    recordings = Recordings(root / "recordings", round(most_mb * 1e6))
    service: tuple[str, ...] = ("--bus", context.bus.endpoint)
    service += () if config.file is None else (str(config.file),)
    jobs = Jobs(context.store, root / "jobs", recordings, machine_files, service)
    reporter = Reporter(context, "http")
    reporter.readings = lambda: {"live_readers": float(len(state.readers))}
    publishers = {axis: context.publisher(axis, COMMAND) for axis in machines}

    def on_kept(axis: str, name: str) -> None:
        command = Command(action="recorded", user="edge-service", note=name)
        publishers[axis].publish(command, now_ns())

    recorder = DisagreementRecorder(recordings.folder, on_kept)
    app = create_app(
        state,
        now_ns,
        own_hosts(http.url),
        partial(give, context),
        jobs,
        recordings,
        partial(_motions, machines),
        outputs=outputs,
        metrics=scrape.text if scrape.output else None,
        authenticator=authenticator,
    )
    serve_app = partial(serve, app, tls=tls)
    try:
        async with reporter.running() as tasks:
            tasks.start("server", _server(context, reporter, serve_app, state), vital=True)
            _follow(context, reporter, tasks, state)
            dispatcher = EventDispatcher(context.events)
            tell = _follow_events(context, tasks, state, dispatcher, recorder)
            app.state.note_change = partial(_note_change, tell)
            tasks.start("tokens", partial(_follow_tokens, authenticator))
            tasks.repeat("refusals", REFUSALS_PERIOD_S, _telling_refusals(state, tell))
            tasks.start("history", partial(_keep_history, history))
            tasks.start("recorder", recorder.run)
            tasks.start("store", partial(dispatcher.watch, tell))
            answer_history(context, state)
            with CLOCK.telling(partial(_clock_set, state, tell)):
                await context.forever()
    finally:
        await jobs.close()
        if folder is None:
            shutil.rmtree(root, ignore_errors=True)
        with suppress(StoreFailedError):
            history.flush(now_ns() / 1e9)


def _motions(machines: Mapping[str, Machine], axis: str) -> list[MotionAnswer]:
    """Motions that end by themselves, with their duration on an axis, or why it refuses them."""
    limits, answers = motion_limits(machines[axis]), []
    for name, motion in MOTIONS.items():
        duration_s, refused = None, None
        try:
            duration_s = motion.duration_s(limits)
        except MotionError as error:
            refused = str(error)
        if duration_s is not None or refused:
            answers.append(
                MotionAnswer(
                    name=name, purpose=motion.purpose, duration_s=duration_s, refused=refused
                )
            )
    return answers


def _place(config: EdgeConfig) -> str:
    """Place of history and events, for people."""
    if config.store.folder is None:
        return "in memory only: it ends with the service"
    return f"on disk, up to {config.store.budget_mb:g} MB; the oldest estimates go first"


async def _keep_history(history: History, heart: Heartbeat) -> None:
    """Write what was heard once a second, until cancelled; what fails is tried again."""
    while True:
        await heart.next(FLUSH_PERIOD_S)
        with suppress(StoreFailedError):  # the watch of the store tells of it
            await heart.in_thread(history.flush, now_ns() / 1e9, limit_s=_FLUSH_LIMIT_S)


def _follow(context: NodeContext, reporter: Reporter, tasks: Tasks, state: ServiceState) -> None:
    """Take in what is shown."""
    preloads = context.subscribe(PRELOAD)
    events, store = context.events, context.store
    reporter.counters = lambda: (
        preloads.counts() | events.counters() | {"lost_estimates": state.history.lost}
    )
    reporter.problems = lambda: [store.problem] if store.problem else []
    reports = context.subscribe_to_components(STATUS)

    def take_preload(axis: str, header: Header, estimate: PreloadEstimate) -> None:
        state.on_preload(axis, header, estimate, now_ns())

    def take_health(_axis: str, header: Header, health: AxisHealth) -> None:
        state.on_health(header, health, now_ns())

    def take_report(_axis: str, _header: Header, report: ComponentHealth) -> None:
        state.on_component(report, now_ns())

    tasks.follow("preloads", preloads, take_preload, vital=True)
    tasks.follow("conditions", context.subscribe(HEALTH), take_health, vital=True)
    tasks.follow("features", context.subscribe(FEAT), state.on_feature)
    tasks.follow("reports", reports, take_report)


def _follow_events(
    context: NodeContext,
    tasks: Tasks,
    state: ServiceState,
    dispatcher: EventDispatcher,
    recorder: DisagreementRecorder,
) -> Callable[[Event], None]:
    """Take in events of the axes and of the service; none of the takers can hold up another.

    Returns what takes in an event of this node itself.
    """
    of_service = context.subscribe_to_components(EVENT)

    def tell(kept: list[StoredEvent], _problem: str) -> None:
        for each in kept:
            state.tell(each)

    def take(event: Event) -> None:
        if state.concerns(event):
            dispatcher.put((event,), tell)
        recorder.note(event)

    def take_event(_axis: str, _header: Header, event: Event) -> None:
        take(event)

    def take_service_event(_axis: str, _header: Header, event: Event) -> None:
        if event.kind in OWN_EVENTS:  # nothing else is theirs to tell
            take(event)

    samples = context.subscribe(RAW, depth=1024)

    def take_samples(axis: str, _header: Header, frame: SampleFrame) -> None:
        recorder.follow(axis, frame)
        samples.rest(axis, SAMPLES_PERIOD_S)

    tasks.start("dispatch", dispatcher.run)
    tasks.follow("events", context.subscribe(EVENT), take_event)
    tasks.follow("service_events", of_service, take_service_event)
    tasks.follow("samples", samples, take_samples)
    return take


async def _follow_tokens(authenticator: Authenticator, heart: Heartbeat) -> None:
    """Let tokens that were added or revoked count within a second."""
    while True:
        with suppress(StoreFailedError):  # its owner reports it; the known ones stay valid
            await heart.in_thread(authenticator.refresh, now_ns())
        await heart.next(TOKENS_PERIOD_S)


def _note_change(tell: Callable[[Event], None], caller: Caller, action: str) -> None:
    """Tell of a change that was made by a request."""
    who = caller.name or ""
    tell(
        Event(
            axis="",
            kind="command",
            severity=Severity.INFO,
            message=f"{who or 'somebody'} ({caller.origin}): {action}",
            time_ns=now_ns(),
            who=who,
            origin=caller.origin,
        )
    )


def _clock_set(state: ServiceState, tell: Callable[[Event], None], step_ns: int) -> None:
    state.move(step_ns)
    tell(clock_changed(step_ns, now_ns()))


def _telling_refusals(state: ServiceState, tell: Callable[[Event], None]) -> Callable[[], None]:
    watch = RefusalWatch()

    def look() -> None:
        for event in watch.tick(state.refused(), now_ns()):
            tell(event)

    return look


def _server(
    context: NodeContext,
    reporter: Reporter,
    serve_app: Callable[..., Coroutine[Any, Any, None]],
    state: ServiceState,
) -> Work:
    """Work of the server: the port that was free at first stays, and is told once."""
    http = context.config.http
    scheme = "http" if http.certificate is None else "https"
    address = Address(http.host, http.port, context.on_http_ready, scheme)

    def bound(host: str, port: int) -> None:
        reporter.to(ComponentStatus.OK)
        address.bound(host, port)

    async def server(heart: Heartbeat) -> None:
        state.open()
        await serve_app(
            address.host,
            address.port,
            stop=asyncio.Event(),
            on_bound=bound,
            before_stop=state.close,
            on_tick=heart.beat,
        )

    return server
