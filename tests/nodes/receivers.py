"""Receivers of webhooks that misbehave, each in its own way, and that keep what they took."""

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from socket import SO_LINGER, SOL_SOCKET
from typing import Any

Writer = asyncio.StreamWriter
Manner = Callable[[Writer], Awaitable[None]]
FINE = b"HTTP/1.1 204 No Content\r\nContent-Length: 0\r\n\r\n"


def says(answer: bytes) -> Manner:
    async def answers(writer: Writer) -> None:
        writer.write(answer)
        await writer.drain()

    return answers


def repeats(beginning: bytes, part: bytes, pause_s: float = 0.0) -> Manner:
    async def answers(writer: Writer) -> None:
        writer.write(beginning)
        while True:
            writer.write(part)
            await writer.drain()
            await asyncio.sleep(pause_s)

    return answers


async def resets(writer: Writer) -> None:
    writer.get_extra_info("socket").setsockopt(SOL_SOCKET, SO_LINGER, struct.pack("ii", 1, 0))


async def says_nothing(writer: Writer) -> None:
    await asyncio.Event().wait()


def _status(status: int, more: str = "") -> Manner:
    return says(f"HTTP/1.1 {status} X\r\n{more}Content-Length: 0\r\n\r\n".encode())


MISBEHAVING: dict[str, Manner] = {
    "closes at once": says(b""),
    "resets the connection": resets,
    "says nothing": says_nothing,
    "half a status line": says(b"HTTP/1.1 2"),
    "garbage": says(b"FOO BAR\r\n\r\n"),
    "bytes of no protocol": says(bytes(range(256)) * 8),
    "a status that is none": says(b"HTTP/1.1 20 OK\r\n\r\n"),
    "a status beyond all": says(b"HTTP/1.1 999 OK\r\n\r\n"),
    "another protocol's greeting": says(b"220 mail.example.org ESMTP\r\n"),
    "HTTP/2": says(b"\x00\x00\x12\x04\x00\x00\x00\x00\x00"),
    "switches protocols": says(b"HTTP/1.1 101 X\r\nUpgrade: x\r\nConnection: upgrade\r\n\r\n"),
    "a header of 200 kB": says(b"HTTP/1.1 200 OK\r\nX: " + b"a" * 200_000 + b"\r\n\r\n"),
    "headers that are none": says(b"HTTP/1.1 200 OK\r\n\x00\xff: \x00\r\nno colon\r\n\r\n"),
    "a length that is none": says(b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n"),
    "two lengths": says(b"HTTP/1.1 200 OK\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n"),
    "endless headers": repeats(b"HTTP/1.1 200 OK\r\n", b"X: " + b"a" * 900 + b"\r\n"),
    "endless 1xx": repeats(b"", b"HTTP/1.1 102 Processing\r\n\r\n", 0.001),
    "one byte at a time": repeats(b"HTTP/1.1 200 OK\r\nX: ", b"a", 0.01),
    "a redirect to itself": _status(302, "Location: /\r\n"),
    "a redirect for good": _status(308, "Location: http://127.0.0.1:9/login\r\n"),
    "a redirect to nowhere": _status(302, "Location: http://[\r\n"),
    "a page to log in": _status(401, "WWW-Authenticate: Basic\r\n"),
    "nobody home": _status(404),
    "a failure": _status(500),
    "busy": _status(429, "Retry-After: 9999999\r\n"),
    "away behind a proxy": _status(502),
    "away for now": _status(503),
}
HANGING = {"says nothing", "endless 1xx", "one byte at a time"}
"""Those that only the sender's patience ends."""
ODD_BUT_FINE: dict[str, Manner] = {
    "no length": says(b"HTTP/1.1 200 OK\r\n\r\n"),
    "an endless body": repeats(b"HTTP/1.1 200 OK\r\n\r\n", b"a" * 1000),
    "a body cut short": says(b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\nx"),
    "a body packed in a lie": says(b"HTTP/1.1 200 OK\r\nContent-Encoding: gzip\r\n\r\nnone"),
    "many cookies": _status(201, "Set-Cookie: =;;\r\n" * 50),
    "HTTP/1.0": says(b"HTTP/1.0 200 OK\r\n\r\n"),
    "a progress report before": says(b"HTTP/1.1 102 Processing\r\n\r\n" + FINE),
}


@dataclass
class Receiver:
    """A server of one address.

    Attributes:
        manner: how the next requests are answered; None properly.
        victims: messages of the events to which `manner` is kept; empty for all.
        greeting: said before anything is asked.
        taken: messages of the events that were answered properly, as they came.
        on_hang: called when it leaves somebody hanging.
        heads: first lines and headers of all requests.
    """

    manner: Manner | None = None
    victims: frozenset[str] = frozenset()
    greeting: bytes = b""
    taken: list[str] = field(default_factory=list)
    heads: list[bytes] = field(default_factory=list)
    requests: int = 0
    on_hang: Callable[[], None] = lambda: None
    port: int = 0

    @property
    def url(self) -> str:
        """Its address."""
        return f"http://127.0.0.1:{self.port}/hook"

    async def serve(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        """Answer one connection."""
        with suppress(OSError, asyncio.IncompleteReadError):
            try:
                await self._answer(reader, writer)
            finally:
                writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        if self.greeting:
            await says(self.greeting)(writer)
            return
        event = await self._read(reader)
        self.requests += 1
        if self.manner is not None and (not self.victims or event["message"] in self.victims):
            if self.manner in [MISBEHAVING[name] for name in HANGING]:
                self.on_hang()
            await self.manner(writer)
            return
        self.taken.append(event["message"])
        await says(FINE)(writer)

    async def _read(self, reader: asyncio.StreamReader) -> dict[str, Any]:
        head = await reader.readuntil(b"\r\n\r\n")
        self.heads.append(head)
        (length,) = (
            int(line.split(b":")[1])
            for line in head.lower().splitlines()
            if line.startswith(b"content-length:")
        )
        event: dict[str, Any] = json.loads(await reader.readexactly(length))
        return event


@asynccontextmanager
async def receiving(port: int = 0) -> AsyncIterator[Receiver]:
    """A receiver for as long as the context lasts."""
    receiver = Receiver()
    answering: set[asyncio.Task[None]] = set()

    def meet(reader: asyncio.StreamReader, writer: Writer) -> None:
        task = asyncio.ensure_future(receiver.serve(reader, writer))
        answering.add(task)
        task.add_done_callback(answering.discard)

    server = await asyncio.start_server(meet, "127.0.0.1", port, reuse_address=True)
    receiver.port = server.sockets[0].getsockname()[1]
    try:
        yield receiver
    finally:
        server.close()
        for task in tuple(answering):
            task.cancel()
        await asyncio.gather(*answering, return_exceptions=True)
        await server.wait_closed()
