"""Receivers of webhooks and brokers that misbehave, and a service that is killed meanwhile.

python -m tests.bench.faults.receivers --away-minutes 10
"""

import asyncio
import os
import re
import signal
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle, pairwise
from pathlib import Path

import click

from ...bus.mqtt import brokers
from ...bus.mqtt.brokers import BadBroker, serving
from ...drivers.bench import free_port
from ...nodes import receivers
from ...nodes.receivers import MISBEHAVING, Receiver, receiving
from ..table import Figure, PipelineBench
from .scene import RunningService, configuration, running_service

OTHERS, MOST_OTHERS_S = 20, 15.0
AWAY_NOTES_PERIOD_S, AWAY_LIFE_S = 5.0, 60.0
_REACHED_S, _ARRIVED_S = 4.0, 90.0
NOTE = b'"kind": "note"'
_NUMBER = re.compile(r"n(\d+)\b")
_TABLES = """
[webhook]
url = "http://127.0.0.1:{hook}/"
secret_file = "secret"
kinds = ["note"]
[mqtt]
host = "127.0.0.1"
port = {broker}
period_s = 60.0
"""


@dataclass
class Outside:
    """Receivers outside of the service, and the notes that it acknowledged.

    Attributes:
        posted: numbers of the notes that were acknowledged.
        by_hook, by_broker: numbers of the notes that arrived, as they came.
        kills: of the service.
    """

    folder: Path
    hook_port: int = field(default_factory=free_port)
    broker_port: int = field(default_factory=free_port)
    posted: list[int] = field(default_factory=list)
    by_hook: list[int] = field(default_factory=list)
    by_broker: list[int] = field(default_factory=list)
    tried: int = 0
    kills: int = 0

    @asynccontextmanager
    async def there(self) -> AsyncIterator[tuple[Receiver, BadBroker]]:
        """Both are there inside; what they took is kept."""
        async with receiving(self.hook_port) as receiver, serving(self.broker_port) as broker:
            try:
                yield receiver, broker
            finally:
                self.by_hook += numbers(receiver.taken)
                self.by_broker += numbers(each.decode() for each in broker.taken if NOTE in each)

    @asynccontextmanager
    async def service(self) -> AsyncIterator[RunningService]:
        """A life of the service, which takes notes."""
        tables = _TABLES.format(hook=self.hook_port, broker=self.broker_port)
        config = configuration(folder=self.folder / "history", tables=tables)
        secret = self.folder / "secret"
        secret.touch(0o600)
        secret.write_text("a secret of some length")
        context = running_service(config, self.folder)
        service = await asyncio.to_thread(context.__enter__)
        try:
            await self.note(service)
            yield service
        finally:
            await asyncio.to_thread(context.__exit__, None, None, None)

    async def note(self, service: RunningService) -> int:
        """Write a note until one is acknowledged; returns its number."""
        while True:
            self.tried += 1
            body = {"action": "note", "user": "bench", "note": f"n{self.tried}"}
            with suppress(OSError):
                path = "/api/v1/axes/X/commands"
                answer = await asyncio.to_thread(service.ask, path, "POST", body)
                if answer.status == 202:
                    self.posted.append(self.tried)
                    return self.tried
            await asyncio.sleep(0.2)

    def kill(self, service: RunningService) -> None:
        """End the service without a word."""
        os.kill(service.pid, signal.SIGKILL)
        self.kills += 1


def numbers(texts: Iterable[str]) -> list[int]:
    """Numbers of the notes of which texts tell."""
    return [int(found[1]) for text in texts if (found := _NUMBER.search(text))]


async def misbehave(outside: Outside) -> None:
    """Let both misbehave in every way, the service be killed, and both come to their senses."""
    manners = zip(MISBEHAVING.items(), cycle(brokers.MISBEHAVING.items()), strict=False)
    for (hook, hook_manner), (broker, broker_manner) in manners:
        async with outside.there() as (receiver, bad):
            receiver.manner, bad.manner = hook_manner, broker_manner
            async with outside.service() as service:
                await _until(lambda: receiver.requests > 0 and bad.connections > 0, _REACHED_S)
                await outside.note(service)
                outside.kill(service)
            receiver.manner = bad.manner = None
            async with outside.service():
                arrived = await _until(partial(_all_there, outside, receiver, bad))
        click.echo(f"{hook} / {broker}: {'all there' if arrived else 'NOT ALL THERE'}", err=True)


def _all_there(outside: Outside, receiver: Receiver, bad: BadBroker) -> bool:
    hook = {*outside.by_hook, *numbers(receiver.taken)}
    told = {*outside.by_broker, *numbers(each.decode() for each in bad.taken if NOTE in each)}
    return set(outside.posted) <= hook & told


@dataclass(frozen=True, slots=True)
class Refused:
    """Outcome of one event of many that was refused for ever.

    Attributes:
        letters: dead letters that were shown.
        others_s: time from its acknowledgement until all others were there.
        came: whether it arrived when it was tried again.
    """

    letters: int
    others_s: float
    came: bool


async def refuse_one(outside: Outside) -> Refused:
    """Let one event of many be refused for ever, and try it again when it is a dead letter."""
    async with outside.there() as (receiver, _), outside.service() as service:
        receiver.manner = receivers.MISBEHAVING["a failure"]
        receiver.victims = frozenset({f"n{outside.tried + 1} (bench)"})
        victim = await outside.note(service)
        begun_s = time.monotonic()
        for _ in range(OTHERS):
            await outside.note(service)
        others = set(outside.posted) - {victim, *outside.by_hook}
        await _until(lambda: others <= set(numbers(receiver.taken)))
        others_s = time.monotonic() - begun_s

        def dead() -> int:
            outputs = service.ask("/api/v1/outputs").json["outputs"]
            return sum(len(each["dead_letters"]) for each in outputs)

        letters = 0
        while not letters and time.monotonic() - begun_s < _ARRIVED_S:
            letters = await asyncio.to_thread(dead)
            await asyncio.sleep(0.2)
        receiver.manner = None
        await asyncio.to_thread(service.ask, "/api/v1/outputs/webhook/dead", "POST")
        came = await _until(lambda: victim in numbers(receiver.taken))
        receiver.taken = [text for text in receiver.taken if victim not in numbers([text])]
        outside.posted.remove(victim)
    return Refused(letters, others_s, came)


async def stay_away(outside: Outside, minutes: float) -> None:
    """Both are away; the service is killed every minute and goes on; both come back."""
    end_s = time.monotonic() + 60.0 * minutes
    while time.monotonic() < end_s:
        life_s = min(time.monotonic() + AWAY_LIFE_S, end_s)
        async with outside.service() as service:
            while time.monotonic() < life_s:
                await outside.note(service)
                await asyncio.sleep(AWAY_NOTES_PERIOD_S)
            outside.kill(service)
    async with outside.there() as (receiver, bad), outside.service():
        await _until(partial(_all_there, outside, receiver, bad))


async def _until(probe: Callable[[], bool], patience_s: float = _ARRIVED_S) -> bool:
    end_s = time.monotonic() + patience_s
    while not probe():
        if time.monotonic() > end_s:
            return False
        await asyncio.sleep(0.05)
    return True


def lost(posted: list[int], arrived: list[int]) -> float:
    """Number of notes that were acknowledged and did not arrive."""
    return float(len(set(posted) - set(arrived)))


def out_of_order(arrived: list[int]) -> float:
    """Number of notes whose first arrival was after that of a later one."""
    first = list(dict.fromkeys(arrived))
    return float(sum(after < before for before, after in pairwise(first)))


async def run(folder: Path, away_minutes: float, *, manners: bool) -> PipelineBench:
    """All of it, one after the other."""
    outside = Outside(folder)
    dead: tuple[Figure, ...] = ()
    if manners:
        await misbehave(outside)
        one = await refuse_one(outside)
        others = f"{OTHERS} others waited behind one that is refused for ever"
        dead = (
            Figure("others", others, one.others_s, "s", at_most=MOST_OTHERS_S),
            Figure("dead", "dead letters shown, of 1", float(one.letters), "", at_least=1.0),
            Figure("revived", "revived ones that arrived", float(one.came), "", at_least=1.0),
        )
    if away_minutes:
        await stay_away(outside, away_minutes)
    hook, broker = outside.by_hook, outside.by_broker
    repeated = len(hook) + len(broker) - len(set(hook)) - len(set(broker))
    figures = (
        Figure("notes", "notes acknowledged", float(len(outside.posted)), ""),
        Figure("kills", "kills of the service", float(outside.kills), ""),
        Figure("away", "away", away_minutes, "min"),
        Figure("hook_lost", "lost by webhook", lost(outside.posted, hook), "", at_most=0.0),
        Figure("hook_order", "out of order", out_of_order(hook), "", at_most=0.0),
        Figure("mqtt_lost", "lost by MQTT", lost(outside.posted, broker), "", at_most=0.0),
        Figure("mqtt_order", "out of order by MQTT", out_of_order(broker), "", at_most=0.0),
        Figure("repeated", "arrived twice, both ways", float(repeated), ""),
        *dead,
    )
    kinds = f"{len(MISBEHAVING)} kinds of receivers, {len(brokers.MISBEHAVING)} of brokers"
    return PipelineBench(figures, (kinds if manners else "receivers and brokers away",))


@click.command()
@click.option("--away-minutes", type=click.FloatRange(0.0), default=10.0, show_default=True)
@click.option("--manners/--no-manners", default=True, show_default=True)
def main(away_minutes: float, manners: bool) -> None:
    """Print what is lost on the way to receivers and brokers that misbehave or are away."""
    with tempfile.TemporaryDirectory() as folder:
        click.echo(asyncio.run(run(Path(folder), away_minutes, manners=manners)).as_text())


if __name__ == "__main__":
    main()
