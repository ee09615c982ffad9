"""Events to another system: signed, in order, none lost, whatever the other side does."""

import asyncio
import hashlib
import hmac
import json
import random
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import WebhookConfig
from edge_service.health.store.events import StoredEvent
from edge_service.messages.event import Event, Severity
from edge_service.nodes.outputs import post
from edge_service.nodes.outputs.signature import DELIVERY, SIGNATURE, TIMESTAMP
from edge_service.nodes.outputs.webhook import LONGEST_PAUSE_S, Webhook, open_webhook

from .conftest import config_of, heart, until
from .receivers import FINE, MISBEHAVING, ODD_BUT_FINE, receiving

SECRET = "a secret of some length"
TRIES = 3
GIVE_UP_TRIES = 6
AWAY = {"busy", "away behind a proxy", "away for now"}
SICK = (post.Outcome.REFUSED, post.Outcome.REFUSED, post.Outcome.NEVER)


@pytest.fixture
def lose_patience(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Ends the exchange that is going on, as if its whole time had passed."""
    exchanges: list[asyncio.Timeout] = []

    def begin() -> asyncio.Timeout:
        exchanges.append(asyncio.timeout(60.0))
        return exchanges[-1]

    monkeypatch.setattr(post, "patience", begin)
    return lambda: exchanges[-1].reschedule(asyncio.get_running_loop().time())


def _event(number: int, kind: str = "alarm_raised") -> Event:
    return Event(axis="X", kind=kind, severity=Severity.ERROR, message=str(number), time_ns=number)


def _logged(number: int, kind: str = "alarm_raised") -> StoredEvent:
    return StoredEvent(number + 1, _event(number, kind))


class Sender:
    """A webhook with its spool, and pauses that take no time.

    Attributes:
        problems: what it said, in order.
        pauses: that it made.
        forever: whether the next pause has no end.
    """

    def __init__(self, url: str, spool: Spool, on_pause: Callable[[int], None]) -> None:
        self.pauses: list[float] = []
        self.forever = False
        self.problems: list[str] = []
        settings = WebhookConfig(
            url=SecretStr(url),
            secret=SecretStr(SECRET),
            kinds=("alarm_raised",),
            tries=TRIES,
            give_up_h=GIVE_UP_TRIES * LONGEST_PAUSE_S / 3600.0,
        )
        self._on_pause = on_pause
        self.spool = spool
        self.webhook = Webhook(settings, spool, self.problems.append, self._pause)

    def _pause(self, seconds: float) -> asyncio.Timeout:
        self.pauses.append(seconds)
        self._on_pause(len(self.pauses))
        return asyncio.timeout(None if self.forever else 0.0)

    async def put(self, numbers: range) -> None:
        for number in numbers:
            self.webhook.put(_logged(number))
        await self.spool.oldest(1)  # the disk does one thing after the other

    async def all_done(self) -> None:
        """Send until nothing waits any more."""

        async def empty() -> bool:
            return len(self.spool) == 0

        await until(empty)


@asynccontextmanager
async def sending(
    url: str, folder: Path, on_pause: Callable[[int], None] = lambda _count: None
) -> AsyncIterator[Sender]:
    """A webhook that sends for as long as the context lasts."""
    spool = await Spool.open(folder / "spool.sqlite", 1000)
    sender = Sender(url, spool, on_pause)
    task = asyncio.create_task(sender.webhook.run(heart()))
    try:
        yield sender
        assert not task.done()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        spool.close()


async def dead(sender: Sender) -> list[str]:
    """Messages of the events that are dead letters."""
    return [json.loads(each.payload)["message"] for each in await sender.spool.letters()]


async def test_events_arrive_in_order_and_signed(tmp_path: Path) -> None:
    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        sender.webhook.put(_logged(9, "note"))
        await sender.put(range(3))
        await sender.all_done()
        assert receiver.taken == ["0", "1", "2"]
        assert sender.webhook.delivered == 3
        lines = receiver.heads[0].decode().split("\r\n")
        headers = dict(line.split(": ", 1) for line in lines[1:] if line)
        body = json.dumps({"schema": "event/1"} | _event(0).model_dump(mode="json")).encode()
        signed = f"{headers[TIMESTAMP]}.".encode() + body
        expected = hmac.new(SECRET.encode(), signed, hashlib.sha256).hexdigest()
        assert headers[SIGNATURE] == f"sha256={expected}"
        assert len(headers[DELIVERY]) == 32


@pytest.mark.parametrize("name", MISBEHAVING)
async def test_a_receiver_that_comes_to_its_senses_gets_all_in_order(
    name: str, tmp_path: Path, lose_patience: Callable[[], None]
) -> None:
    async with receiving() as receiver:

        def behave(pauses: int) -> None:
            if pauses == TRIES - 1:
                receiver.manner = None

        receiver.manner, receiver.on_hang = MISBEHAVING[name], lose_patience
        async with sending(receiver.url, tmp_path, behave) as sender:
            await sender.put(range(3))
            await sender.all_done()
            assert receiver.taken == ["0", "1", "2"]
            assert sender.spool.dead == 0
            assert sender.pauses == [1.0, 2.0]
            assert sender.problems[-1] == ""
            assert sender.problems[0].startswith(f"http://127.0.0.1:{receiver.port}: ")


@pytest.mark.parametrize("name", MISBEHAVING)
async def test_an_event_that_it_never_takes_is_a_dead_letter_and_the_next_go(
    name: str, tmp_path: Path, lose_patience: Callable[[], None]
) -> None:
    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        receiver.manner, receiver.victims = MISBEHAVING[name], frozenset({"1"})
        receiver.on_hang = lose_patience
        await sender.put(range(4))
        await sender.all_done()
        tries = GIVE_UP_TRIES if name in AWAY else TRIES + 1
        assert receiver.taken == ["0", "2", "3"]
        assert receiver.requests == 3 + tries
        assert await dead(sender) == ["1"]
        (letter,) = await sender.spool.letters()
        assert letter.tries == tries
        receiver.manner = None
        assert await sender.spool.revive(letter.key)
        await sender.all_done()
        assert receiver.taken == ["0", "2", "3", "1"]


@pytest.mark.parametrize("name", sorted(MISBEHAVING.keys() - AWAY))
async def test_a_sick_receiver_costs_no_event_and_no_order(
    name: str, tmp_path: Path, lose_patience: Callable[[], None]
) -> None:
    async with receiving() as receiver:

        def recover(pauses: int) -> None:
            if pauses == GIVE_UP_TRIES - 1:
                receiver.manner = None

        receiver.manner, receiver.on_hang = MISBEHAVING[name], lose_patience
        async with sending(receiver.url, tmp_path, recover) as sender:
            await sender.put(range(5))
            await sender.all_done()
            assert receiver.taken == [str(number) for number in range(5)]
            assert sender.spool.dead == 0


async def test_with_the_default_others_wait_seconds_for_one_that_is_always_refused(
    tmp_path: Path,
) -> None:
    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        receiver.manner, receiver.victims = MISBEHAVING["a failure"], frozenset({"0"})
        sender.webhook._tries = WebhookConfig().tries
        await sender.put(range(20))
        await sender.all_done()
        assert await dead(sender) == ["0"]
        assert sum(sender.pauses) < 10.0


async def test_an_event_that_comes_while_a_refused_one_pauses_does_not_wait_for_it(
    tmp_path: Path,
) -> None:
    async with receiving() as receiver:
        receiver.manner, receiver.victims = MISBEHAVING["a failure"], frozenset({"0"})
        resting = asyncio.Event()

        def rest(pauses: int) -> None:
            if pauses == TRIES:
                sender.forever = True
                resting.set()

        async with sending(receiver.url, tmp_path, rest) as sender:
            await sender.put(range(1))
            await resting.wait()
            await sender.put(range(1, 2))
            await sender.all_done()
            assert receiver.taken == ["1"]
            assert await dead(sender) == ["0"]


@pytest.mark.parametrize("seed", range(20))
async def test_whatever_is_refused_when_no_event_is_lost_doubled_or_wrongly_dead(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sick, away and well by turns, restarts between, and events that are refused for ever."""
    dice = random.Random(seed)
    poisoned = {str(number) for number in range(40) if dice.random() < dice.choice((0.0, 0.1, 0.5))}
    state, taken, posts = ["well"], [], [0]

    async def reply(_poster: post.Poster, body: bytes, _headers: Any) -> post.Reply:
        posts[0] += 1
        message = json.loads(body)["message"]
        if state[0] != "well":
            return post.Reply(dice.choice(SICK) if state[0] == "sick" else post.Outcome.LATER)
        if message in poisoned:
            return post.Reply(dice.choice(SICK))
        taken.append(message)
        return post.Reply(post.Outcome.TAKEN)

    monkeypatch.setattr(post.Poster, "post", reply)

    def change(_pauses: int) -> None:
        state[0] = dice.choice(("well", "sick", "away")) if posts[0] < 400 else "well"

    for life in range(4):
        async with sending("http://127.0.0.1:9/", tmp_path, change) as sender:
            sender.webhook._most_pauses = 1_000_000
            await sender.put(range(10 * life, 10 * life + 10))
            before = posts[0]

            async def over(before: int = before, sender: Sender = sender) -> bool:
                return posts[0] > before + 20 or len(sender.spool) == 0

            await until(over)
    async with sending("http://127.0.0.1:9/", tmp_path, change) as sender:
        sender.webhook._most_pauses = 1_000_000
        await sender.put(range(40, 80))  # by which the last ones are judged
        await sender.all_done()
        assert taken == sorted(set(taken), key=int)
        assert set(taken) == {str(number) for number in range(80)} - poisoned
        assert set(await dead(sender)) == poisoned


@pytest.mark.parametrize("name", ODD_BUT_FINE)
async def test_what_follows_a_good_status_matters_to_nobody(name: str, tmp_path: Path) -> None:
    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        receiver.manner = ODD_BUT_FINE[name]
        await sender.put(range(2))
        await sender.all_done()
        assert (receiver.requests, sender.webhook.delivered, sender.spool.dead) == (2, 2, 0)


@pytest.mark.parametrize("status", [400, 413, 415, 422])
async def test_what_was_read_and_refused_is_not_tried_again(status: int, tmp_path: Path) -> None:
    async def refuse(writer: asyncio.StreamWriter) -> None:
        writer.write(FINE.replace(b"204", b"%d" % status))

    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        receiver.manner, receiver.victims = refuse, frozenset({"0"})
        await sender.put(range(2))
        await sender.all_done()
        assert (receiver.requests, receiver.taken, sender.pauses) == (2, ["1"], [])
        assert await dead(sender) == ["0"]


async def test_no_request_goes_where_a_redirect_points(tmp_path: Path) -> None:
    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        receiver.manner = MISBEHAVING["a redirect to itself"]
        await sender.put(range(1))
        await sender.all_done()
        assert receiver.requests == GIVE_UP_TRIES
        assert all(head.startswith(b"POST /hook ") for head in receiver.heads)


async def test_a_receiver_that_speaks_no_tls_is_away(tmp_path: Path) -> None:
    async with receiving() as receiver:
        receiver.greeting = bytes(range(256))
        url = receiver.url.replace("http:", "https:")
        async with sending(url, tmp_path) as sender:
            await sender.put(range(1))
            await sender.all_done()
            assert receiver.requests == 0
            assert await dead(sender) == ["0"]
            assert "cannot be reached" in sender.problems[0]


async def test_while_it_is_away_nothing_is_lost_through_restarts(tmp_path: Path) -> None:
    async with receiving() as receiver:
        port = receiver.port
    for number in range(3):
        async with sending(receiver.url, tmp_path) as sender:
            sender.webhook._most_pauses = 1_000_000
            await sender.put(range(10 * number, 10 * number + 10))
            assert len(sender.spool) == 10 * number + 10
    async with receiving(port) as again, sending(again.url, tmp_path) as sender:
        await sender.all_done()
        assert again.taken == [str(number) for number in range(30)]


async def test_pauses_grow_up_to_a_minute(tmp_path: Path) -> None:
    pauses: list[float] = []
    async with receiving() as receiver:
        pass
    async with sending(receiver.url, tmp_path) as sender:
        sender.webhook._most_pauses = 9
        await sender.put(range(1))
        await sender.all_done()
        pauses += sender.pauses
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]


async def test_a_failure_of_the_library_that_nobody_knows_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(*_args: Any) -> None:
        raise ZeroDivisionError

    async with receiving() as receiver, sending(receiver.url, tmp_path) as sender:
        monkeypatch.setattr(post.Poster, "_exchange", fail)
        await sender.put(range(1))
        await sender.all_done()
        assert await dead(sender) == ["0"]
        assert sender.problems[-1].endswith("sent an answer that is not HTTP (ZeroDivisionError)")


async def test_without_a_url_there_is_no_webhook() -> None:
    assert await open_webhook(config_of("simulated", {}), lambda _problem: None) is None


async def test_what_a_receiver_should_know_alone_is_in_no_problem(tmp_path: Path) -> None:
    async with receiving() as receiver:
        url = receiver.url.replace("//", "//user:marker@") + "/token-marker?key=marker"
        async with sending(url, tmp_path) as sender:
            receiver.manner = MISBEHAVING["garbage"]
            await sender.put(range(1))
            await sender.all_done()
            assert b"Authorization: Basic" in receiver.heads[0]
            assert "marker" not in " ".join(sender.problems)
