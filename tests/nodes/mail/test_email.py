"""Events by e-mail to a foreign server: none lost, no storm, however the server behaves."""

import asyncio
import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import EmailConfig
from edge_service.health.store.events import StoredEvent
from edge_service.messages.event import Event, Severity
from edge_service.nodes.outputs.mail import smtp
from edge_service.nodes.outputs.mail.letter import MOST_TOLD
from edge_service.nodes.outputs.mail.output import Email
from edge_service.nodes.outputs.ordered import LONGEST_PAUSE_S

from ..conftest import heart, until
from .mail_server import PASSWORD, USER, MailServer, mail_server, tls_of

GATHER_S, MOST_PER_HOUR = 30.0, 3
PLAIN = {"security": "plain"}


def _logged(number: int, severity: Severity = Severity.ERROR) -> StoredEvent:
    return StoredEvent(
        number + 1,
        Event(axis="X", kind="alarm_raised", severity=severity, message=f"<{number}>", time_ns=1),
    )


class Sender:
    """The output with its spool, and pauses that only its own clock knows."""

    def __init__(self, port: int, spool: Spool, changes: dict[str, Any]) -> None:
        self.now_s = 0.0
        self.problems: list[str] = []
        self.on_pause: Callable[[], None] = lambda: None
        settings = EmailConfig.model_validate(
            {
                "host": "127.0.0.1",
                "port": port,
                "sender": "edge@example.org",
                "recipients": ["one@example.org", "two@example.org"],
                "gather_s": GATHER_S,
                "most_per_hour": MOST_PER_HOUR,
            }
            | changes
        )
        said = self.problems.append
        self.spool = spool
        self.email = Email(
            settings, "hall/mill", spool, lambda _: None, said, self._pause, lambda: self.now_s
        )

    def _pause(self, seconds: float) -> asyncio.Timeout:
        self.now_s += seconds
        self.on_pause()
        return asyncio.timeout(0.0)

    async def put(self, *numbers: int) -> None:
        for number in numbers:
            self.email.put(_logged(number))
        await self.spool.oldest(1)  # the disk does one thing after the other

    async def all_done(self) -> None:
        async def empty() -> bool:
            return len(self.spool) == 0

        try:
            await until(empty)
        except TimeoutError:
            pytest.fail(str(self.problems[-3:]))


@asynccontextmanager
async def sending(port: int, folder: Path, **changes: Any) -> AsyncIterator[Sender]:
    """The output, at work for as long as the context lasts."""
    spool = await Spool.open(folder / "spool.sqlite", 10_000)
    sender = Sender(port, spool, PLAIN | changes)
    task = asyncio.create_task(sender.email.run(heart()))
    try:
        yield sender
        assert not task.done()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        spool.close()


def told(server: MailServer) -> list[list[int]]:
    """Numbers of the events in each letter, by its text and as well by its HTML."""
    found = []
    for letter in server.taken:
        text, html = (
            part.get_content() for part in (letter.get_body(("plain",)), letter.get_body(("html",)))
        )
        numbers = [n for n in range(100) if f"<{n}>" in text]
        assert numbers == [n for n in range(100) if f"&lt;{n}&gt;" in html]
        found.append(numbers)
    return found


@pytest.mark.parametrize("security", ["starttls", "tls"])
async def test_letters_go_encrypted_and_by_a_login(security: str, tmp_path: Path) -> None:
    changes = {
        "security": security,
        "user": USER.decode(),
        "password": PASSWORD.decode(),
        "ca_certificate": tmp_path / "ca.pem",
    }
    tls = tls_of(tmp_path)
    async with mail_server(tls, from_the_beginning=security == "tls") as server:
        async with sending(server.port, tmp_path, **changes) as sender:
            await sender.put(1)
            await sender.all_done()
        (letter,) = server.taken
        assert (server.users, sender.problems) == ([USER], [""])
        assert letter["To"] == "one@example.org, two@example.org"
        assert letter["Auto-Submitted"] == "auto-generated"
        assert letter["Date"].datetime.tzinfo is not None
        assert letter["Message-ID"].endswith("@example.org>")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"password": "wrong"}, "to the login answered 535"),
        ({"ca_certificate": None}, "cannot be trusted"),
        ({"security": "tls"}, "does not speak TLS ("),
        ({"security": "plain", "user": None, "password": None}, "answered 530"),
    ],
)
async def test_a_server_that_does_not_let_us_in_is_waited_for_and_named(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    right = {
        "security": "starttls",
        "user": USER.decode(),
        "password": PASSWORD.decode(),
        "ca_certificate": tmp_path / "ca.pem",
    }
    async with mail_server(tls_of(tmp_path)) as server:
        async with sending(server.port, tmp_path, **(right | changes)) as sender:
            await sender.put(1)

            async def tried() -> bool:
                return len(sender.problems) >= 2

            await until(tried)
            assert all(said in each for each in sender.problems), sender.problems
            assert (len(sender.spool), sender.spool.dead, server.taken) == (1, 0, [])
        async with sending(server.port, tmp_path, **right) as sender:
            await sender.all_done()  # as soon as the configuration is right
        assert told(server) == [[1]]


async def test_a_server_without_starttls_is_given_no_letter(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path, security="starttls") as sent:
        await sent.put(1)

        async def tried() -> bool:
            return bool(sent.problems)

        await until(tried)
        assert sent.problems[0].endswith("does not offer STARTTLS")
        assert server.tries == 0


async def test_what_a_server_refuses_for_good_is_a_dead_letter_and_said(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.on_data = ["554 spam"]
        await sender.put(1, 2)
        await sender.all_done()
        letters = await sender.spool.letters()
        assert [json.loads(each.payload)["message"] for each in letters] == ["<1>", "<2>"]
        assert {each.reason for each in letters} == {"answered 554"}
        assert (server.tries, sender.problems[-1].partition(": ")[2]) == (1, "answered 554")
        await sender.spool.revive(letters[0].key)
        await sender.all_done()
        assert told(server) == [[1]]


async def test_recipients_that_are_refused_are_told_and_the_others_get_it(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.on_recipient = lambda each: "550 unknown" if each.startswith("one") else None
        await sender.put(1)
        await sender.all_done()
        assert told(server) == [[1]]
        assert sender.problems[-1].endswith("answered 550 for 1 of 2 recipients")
        server.on_recipient = lambda _each: "550 unknown"
        await sender.put(2)
        await sender.all_done()
        assert sender.spool.dead == 1


@pytest.mark.parametrize("answers", [["451 later", "452 full"], ["421 closing", "451 later"]])
async def test_a_server_that_is_busy_gets_the_same_letter_later(
    answers: list[str], tmp_path: Path
) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.on_data = answers
        await sender.put(1)

        async def tried() -> bool:
            return server.tries >= 2

        await until(tried)
        await sender.put(2)
        await sender.all_done()
        assert told(server) == [[1], [2]]
        assert sender.spool.dead == 0


async def test_a_server_that_stays_away_costs_the_letter_only_after_all_pauses(
    tmp_path: Path,
) -> None:
    give_up_h = 5 * LONGEST_PAUSE_S / 3600.0
    async with mail_server() as server, sending(server.port, tmp_path, give_up_h=give_up_h) as sent:
        server.on_data = ["451 later"] * 5
        await sent.put(1, 2)

        async def given_up() -> bool:
            return sent.spool.dead == 2

        await until(given_up)
        letters = await sent.spool.letters()
        assert [(each.tries, each.reason) for each in letters] == [(5, "answered 451")] * 2
        await sent.put(3)
        await sent.all_done()
        assert told(server) == [[3]]


async def test_an_event_of_another_version_holds_up_nothing(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        await sender.spool.put("X/alarm_raised", b'{"schema": "event/9"}')
        await sender.put(1)
        await sender.all_done()
        assert told(server) == [[1]]
        assert "another version" in server.taken[0].get_body(("plain",)).get_content()


async def test_a_sender_that_is_refused_costs_no_letter(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.on_sender = "550 not yours"
        await sender.put(1)

        async def tried() -> bool:
            return len(sender.problems) >= 2

        await until(tried)
        assert sender.problems[0].endswith("to the sender answered 550")
        server.on_sender = None
        await sender.all_done()
        assert (told(server), sender.spool.dead) == ([[1]], 0)


async def test_a_letter_that_comes_twice_has_one_name_and_one_content(tmp_path: Path) -> None:
    """The connection breaks between the letter and its receipt."""
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.drops = 2
        await sender.put(1, 2)

        async def dropped() -> bool:
            return server.drops == 0

        await until(dropped)
        await sender.put(3)
        await sender.all_done()
        first, again = server.dropped
        assert told(server) == [[1, 2], [3]]
        last = server.taken[0]
        assert first["Message-ID"] == again["Message-ID"] == last["Message-ID"]
        assert first.as_bytes() == again.as_bytes() == last.as_bytes()
        assert last["Message-ID"] != server.taken[1]["Message-ID"]
        assert "closed the connection" in sender.problems[0]


async def test_a_server_that_says_nothing_more_is_given_up_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits: list[asyncio.Timeout] = []

    def begin() -> asyncio.Timeout:
        limits.append(asyncio.timeout(60.0))
        return limits[-1]

    monkeypatch.setattr(smtp, "patience", begin)
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        server.hangs = asyncio.Event()
        await sender.put(1)
        await server.hangs.wait()
        server.hangs = None
        limits[0].reschedule(asyncio.get_running_loop().time())
        await sender.all_done()
        assert "took longer than" in sender.problems[0]
        assert told(server) == [[1]]


async def test_what_happens_within_a_short_time_goes_in_one_letter(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        joined = iter([2, 3])

        def more() -> None:
            for number in joined:
                sender.email.put(_logged(number))

        sender.on_pause = more
        await sender.put(1)
        await sender.all_done()
        assert told(server) == [[1, 2, 3]]
        assert sender.now_s == GATHER_S


async def test_a_storm_of_events_is_no_storm_of_letters(tmp_path: Path) -> None:
    """Events without end for three hours: no hour has more letters than the bound, all are told."""
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        count, sent_s = 0, []

        def happen() -> None:
            nonlocal count
            if sender.now_s < 3 * 3600.0:
                sender.email.put(_logged(count := count + 1))

        def noted(address: str) -> None:
            if address.startswith("one"):
                sent_s.append(sender.now_s)
            happen()

        server.on_recipient, sender.on_pause = noted, happen
        happen()

        async def over() -> bool:
            return sender.now_s >= 3 * 3600.0 and len(sender.spool) == 0

        await until(over)
        for at_s in sent_s:
            assert sum(at_s <= other < at_s + 3600.0 for other in sent_s) <= MOST_PER_HOUR
        assert len(server.taken) == len(sent_s) > 3 * MOST_PER_HOUR - 3
        texts = [letter.get_body(("plain",)).get_content() for letter in server.taken]
        earlier = [int(n) for text in texts for n in re.findall(r"(\d+) earlier event", text)]
        named = [len(re.findall(r"(?m)^  .*<\d+>\s*$", text)) for text in texts]
        assert sum(named) + sum(earlier) == count > 100
        assert max(named) <= MOST_TOLD


async def test_what_is_not_grave_enough_is_not_sent(tmp_path: Path) -> None:
    async with mail_server() as server, sending(server.port, tmp_path) as sender:
        sender.email.put(_logged(1, Severity.INFO))
        sender.email.put(_logged(2, Severity.WARNING))
        await sender.spool.oldest(1)
        await sender.all_done()
        assert told(server) == [[2]]
