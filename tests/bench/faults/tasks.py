"""Every task of a running service, ended, raising and hung on purpose: how soon is it seen?

python -m tests.bench.faults.tasks           # --only ended, raised or hung
"""

import asyncio
import tempfile
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import click
import httpx

from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings
from edge_service.bus.subscriber import Subscriber
from edge_service.config import EdgeConfig, load_config
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.event import Event
from edge_service.messages.topics import EVENT, PRELOAD
from edge_service.nodes.service import OPTIONAL, PIPELINE, run_nodes
from edge_service.nodes.supervision.heartbeat import Heartbeat
from edge_service.nodes.supervision.supervisor import Supervisor
from edge_service.nodes.supervision.task import SupervisedTask, TaskState, Work
from edge_service.nodes.wiring.context import NodeContext

from ..table import aligned
from .scene import configuration

AXES = ("X", "Y")
PATIENCE_S = 30.0
MOST_SEEN_S = 2.0
_LOOK_PERIOD_S = 0.01
_TABLES = """
[vibration]
interval_s = 1.0
[webhook]
url = "http://127.0.0.1:9/"
secret_file = "webhook.secret"
[mqtt]
host = "127.0.0.1"
port = 9
"""


async def end(_heart: Heartbeat) -> None:
    """End without a word."""


async def fail(_heart: Heartbeat) -> None:
    """Raise what nobody foresaw."""
    raise RuntimeError("on purpose")


async def hang(_heart: Heartbeat) -> None:
    """Never go on."""
    await asyncio.Event().wait()


WAYS: dict[str, Work] = {"ended": end, "raised": fail, "hung": hang}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one task that failed in one way.

    Attributes:
        seen_s, mended_s: times until the event was heard, and until the task worked again.
        shown: whether `/readyz` named it.
        gap_s: longest pause between two estimates of an axis that the task does not work for.
    """

    component: str
    task: str
    way: str
    seen_s: float
    mended_s: float
    shown: bool
    gap_s: float

    @property
    def right(self) -> bool:
        """True if it is as it should be."""
        return self.seen_s <= MOST_SEEN_S and self.mended_s < PATIENCE_S and self.shown


class Scene:
    """A service in this process, heard over its bus and asked over HTTP."""

    def __init__(
        self, bus: Bus, config: EdgeConfig, supervisor: Supervisor, urls: list[str]
    ) -> None:
        self.supervisor = supervisor
        self._urls = urls
        self._told: dict[tuple[object, object], float] = {}
        self._estimates: dict[str, list[float]] = {axis: [] for axis in AXES}
        events = bus.subscribe(config.keys.all_components(EVENT), EVENT, depth=4096)
        preloads = bus.subscribe(config.keys.all_axes(PRELOAD), PRELOAD, depth=4096)
        self._hearing = [
            asyncio.create_task(self._hear_events(events)),
            asyncio.create_task(self._hear_preloads(preloads)),
        ]

    async def _hear_events(self, events: Subscriber[Event]) -> None:
        async for _, _, event in events:
            if event.kind == "task_failed":
                key = (event.data["component"], event.data["task"])
                self._told.setdefault(key, time.monotonic())

    async def _hear_preloads(self, preloads: Subscriber[PreloadEstimate]) -> None:
        async for axis, _, _ in preloads:
            self._estimates[axis].append(time.monotonic())

    async def strike(self, component: str, name: str, way: str) -> Outcome | None:
        """Let the next life of a task fail, and see what comes of it; None if it may."""
        task = self._find(component, name)
        if task is None or (way == "ended" and task.rules.may_end):
            return None
        task.running.cancel()
        await asyncio.wait([task.running], timeout=PATIENCE_S)
        self._told.clear()
        for times in self._estimates.values():
            times.clear()
        work, task.work = task.work, WAYS[way]
        begun_s = time.monotonic()
        task.begin()
        task.work = work
        key = (component.partition(" ")[0], name)
        await _until(lambda: key in self._told)
        seen_s = self._told.get(key, float("inf")) - begun_s
        shown = await self._is_shown(component.partition(" ")[0])
        await _until(lambda: task.state is TaskState.RUNNING and not task.running.done())
        mended_s = time.monotonic() - begun_s
        await asyncio.sleep(1.0)
        return Outcome(component, name, way, seen_s, mended_s, shown, self._gap_s(component))

    async def settled(self) -> None:
        """Wait until nothing is wrong any more."""
        await _until(lambda: not any(task.fault for group in self.supervisor for task in group))

    def _find(self, component: str, name: str) -> SupervisedTask | None:
        for group in self.supervisor:
            for task in group:
                if (group.component, task.name) == (component, name):
                    return task
        return None

    async def _is_shown(self, component: str) -> bool:
        asked_s = time.monotonic()
        while time.monotonic() - asked_s < MOST_SEEN_S:
            try:
                async with httpx.AsyncClient(base_url=self._urls[-1]) as client:
                    ready = await client.get("readyz")
            except httpx.HTTPError:
                await asyncio.sleep(0.1)
                continue
            if ready.status_code == 503 and f"part_down: {component}" in ready.text:
                return True
            await asyncio.sleep(_LOOK_PERIOD_S)
        return False

    def _gap_s(self, component: str) -> float:
        others = [axis for axis in AXES if component != f"acquire {axis}"]
        pauses = [
            later - earlier
            for axis in others
            for earlier, later in zip(
                self._estimates[axis], self._estimates[axis][1:], strict=False
            )
        ]
        return max(pauses, default=float("inf"))

    def close(self) -> None:
        """Hear no more."""
        for each in self._hearing:
            each.cancel()


async def _until(probe: Callable[[], bool]) -> None:
    """Wait until something holds, for a while."""
    begun_s = time.monotonic()
    while not probe() and time.monotonic() - begun_s < PATIENCE_S:
        await asyncio.sleep(_LOOK_PERIOD_S)


@asynccontextmanager
async def service(folder: Path) -> AsyncIterator[Scene]:
    """A service with two axes, webhook, MQTT and vibration."""
    secret = folder / "webhook.secret"
    secret.write_text("a secret of some length")
    secret.chmod(0o600)
    path = folder / "edge.toml"
    path.write_text(configuration(AXES, folder=folder / "history", tables=_TABLES))
    config = load_config(path)
    bus = await Bus.open(BusSettings(config.bus.endpoint, "router"))
    stop, supervisor = asyncio.Event(), Supervisor()

    urls: list[str] = []
    context = NodeContext(config, bus, urls.append, supervisor=supervisor)
    names: tuple[str, ...] = (*OPTIONAL, *PIPELINE)
    running = asyncio.create_task(run_nodes(context, names, stop))
    try:
        await _until(lambda: bool(urls) or running.done())
        if running.done():
            running.result()
        scene = Scene(bus, config, supervisor, urls)
        await _until(lambda: scene._find("estimate", "keep") is not None)
        await asyncio.sleep(3.0)
        yield scene
        scene.close()
    finally:
        stop.set()
        await asyncio.wait([running])
        await bus.close()


async def run(ways: tuple[str, ...], tell: Callable[[Outcome], None]) -> list[Outcome]:
    """Strike every task in every way, one after the other."""
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        async with service(Path(folder)) as scene:
            pairs = [(group.component, task.name) for group in scene.supervisor for task in group]
            for way in ways:
                for component, name in sorted(pairs, key=lambda pair: pair[0] == "service"):
                    outcome = await scene.strike(component, name, way)
                    if outcome is not None:
                        outcomes.append(outcome)
                        tell(outcome)
                    await scene.settled()
    return outcomes


def as_table(outcomes: list[Outcome]) -> list[str]:
    """Lines of a table: a line for each way, with the worst of all tasks."""
    rows = [("way", "tasks", "seen, s", "works again, s", "shown", "others' gap, s", "right")]
    for way in dict.fromkeys(each.way for each in outcomes):
        of_way = [each for each in outcomes if each.way == way]
        rows.append(
            (
                way,
                str(len(of_way)),
                f"{max(each.seen_s for each in of_way):.2f}",
                f"{max(each.mended_s for each in of_way):.2f}",
                str(sum(each.shown for each in of_way)),
                f"{max(each.gap_s for each in of_way):.2f}",
                str(sum(each.right for each in of_way)),
            )
        )
    return aligned(rows, right=range(1, 7))


@click.command()
@click.option("--only", type=click.Choice(list(WAYS)), help="One way of failing.")
def main(only: str | None) -> None:
    """End, fail and hang every task of a service, and print what came of it."""

    def tell(each: Outcome) -> None:
        click.echo(
            f"{each.component}: {each.task} {each.way}: seen after {each.seen_s:.2f} s, works again"
            f" after {each.mended_s:.2f} s, {'' if each.shown else 'not '}shown,"
            f" others' longest pause {each.gap_s:.2f} s{'' if each.right else '  <-- WRONG'}"
        )

    outcomes = asyncio.run(run((only,) if only else tuple(WAYS), tell))
    for line in as_table(outcomes):
        click.echo(line)
    raise SystemExit(0 if all(each.right for each in outcomes) else 1)


if __name__ == "__main__":
    main()
