"""Mail servers that misbehave, each in its own way: nothing is lost, nothing hangs."""

import asyncio
from pathlib import Path

import pytest

from edge_service.nodes.outputs.mail import smtp

from ...drivers.bench import free_port
from ..conftest import until
from ..receivers import Manner, repeats, resets, says, says_nothing
from .mail_server import mail_server
from .test_email import sending, told

HELLO = b"220 odd ESMTP\r\n"
ODD: dict[str, Manner] = {
    "closes at once": says(b""),
    "resets the connection": resets,
    "says nothing": says_nothing,
    "half a line": says(b"220"),
    "garbage": says(b"\x00\xff\xfe\r\n" * 9),
    "another protocol": says(b"HTTP/1.1 400 Bad Request\r\n\r\n"),
    "not ready": says(b"554 no service here\r\n"),
    "busy": says(b"421 too busy\r\n"),
    "a number that is none": says(b"999 hello\r\n" * 9),
    "no number": says(b"two-two-zero\r\n"),
    "a line without end": repeats(b"220 ", b"a" * 10_000),
    "lines without end": repeats(b"", b"220-hello\r\n" * 1000, 0.001),
    "one byte at a time": repeats(b"220-", b"a", 0.01),
    "greets and goes": says(HELLO),
    "greets and is silent": repeats(HELLO, b"", 0.1),
    "greets and answers nonsense": says(HELLO + b"hm\r\n" * 20),
    "greets and refuses all": says(HELLO + b"502 no\r\n" * 20),
    "takes back all": says(HELLO + b"250 fine\r\n" * 3 + b"421 gone\r\n"),
}


@pytest.mark.parametrize("name", ODD)
async def test_an_odd_server_is_named_and_gets_the_letter_when_it_has_come_to_its_senses(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smtp, "patience", lambda: asyncio.timeout(0.4))
    monkeypatch.setattr(smtp, "STEP_S", 0.3)
    port, meetings = free_port(), set[asyncio.Task[None]]()

    async def answer(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        meetings.add(asyncio.current_task())
        try:
            await ODD[name](writer)
            writer.close()
        except (OSError, asyncio.CancelledError):
            writer.transport.abort()

    server = await asyncio.start_server(answer, "127.0.0.1", port)
    async with sending(port, tmp_path) as sender:
        await sender.put(1)

        async def tried() -> bool:
            return len(sender.problems) >= 2

        await until(tried)
        assert (len(sender.spool), sender.spool.dead) == (1, 0)
        assert all(each.startswith(f"127.0.0.1:{port}: ") for each in sender.problems)
        server.close()
        for each in meetings:
            each.cancel()
        await asyncio.gather(*meetings, return_exceptions=True)
        monkeypatch.undo()
        async with mail_server(port=port) as well:
            await sender.all_done()
            assert told(well) == [[1]]
