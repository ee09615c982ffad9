"""Brokers that misbehave, each in its own way, and that keep what they took."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

Writer = asyncio.StreamWriter
Manner = Callable[["BadBroker", asyncio.StreamReader, Writer], Awaitable[None]]
CONNECT, CONNACK, PUBLISH, PUBACK, SUBSCRIBE, SUBACK, PING, PONG = 1, 2, 3, 4, 8, 9, 12, 13
WELCOME = bytes([CONNACK << 4, 2, 0, 0])


async def read_packet(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Type with flags, and content, of the next packet."""
    first = (await reader.readexactly(1))[0]
    length = shift = 0
    while True:
        byte = (await reader.readexactly(1))[0]
        length, shift = length | (byte & 0x7F) << shift, shift + 7
        if not byte & 0x80:
            return first, await reader.readexactly(length)


def _says(answer: bytes) -> Manner:
    async def manner(_broker: "BadBroker", reader: asyncio.StreamReader, writer: Writer) -> None:
        await read_packet(reader)
        writer.write(answer)
        await writer.drain()

    return manner


def _hangs(answer: bytes) -> Manner:
    async def manner(_broker: "BadBroker", reader: asyncio.StreamReader, writer: Writer) -> None:
        writer.write(answer)
        while await reader.read(4096):  # takes everything, and never says another word
            pass

    return manner


async def _never_stops(_broker: "BadBroker", reader: asyncio.StreamReader, writer: Writer) -> None:
    await read_packet(reader)
    while True:
        writer.write(b"\x00" * 1000)
        await writer.drain()
        await asyncio.sleep(0)


async def _closes_at_a_message(
    broker: "BadBroker", reader: asyncio.StreamReader, writer: Writer
) -> None:
    await read_packet(reader)
    writer.write(WELCOME)
    while True:
        kind, content = await read_packet(reader)
        if kind >> 4 == SUBSCRIBE:
            writer.write(bytes([SUBACK << 4, 3, *content[:2], 1]))
        elif kind >> 4 == PUBLISH and b"/online" not in content:
            return
        elif kind >> 4 == PUBLISH:
            broker.acknowledge(content, writer)


async def _acknowledges_others(
    _broker: "BadBroker", reader: asyncio.StreamReader, writer: Writer
) -> None:
    await read_packet(reader)
    writer.write(WELCOME)
    while True:
        await read_packet(reader)
        writer.write(bytes([PUBACK << 4, 2, 0xFF, 0xFE]))
        await writer.drain()


MISBEHAVING: dict[str, Manner] = {
    "closes at once": _says(b""),
    "says nothing": _hangs(b""),
    "garbage": _says(bytes(range(256)) * 8),
    "another protocol's greeting": _says(b"220 mail.example.org ESMTP\r\n"),
    "HTTP": _says(b"HTTP/1.1 400 Bad Request\r\n\r\n"),
    "half a welcome": _says(WELCOME[:2]),
    "a welcome of no length": _says(bytes([CONNACK << 4, 0])),
    "a length without end": _says(bytes([CONNACK << 4]) + b"\xff" * 9),
    "a promise of 256 MB": _hangs(bytes([PUBLISH << 4, 0xFF, 0xFF, 0xFF, 0x7F])),
    "never stops": _never_stops,
    "does not know us": _says(bytes([CONNACK << 4, 2, 0, 5])),
    "a wrong password": _says(bytes([CONNACK << 4, 2, 0, 4])),
    "refuses for a reason of its own": _says(bytes([CONNACK << 4, 2, 0, 99])),
    "never acknowledges": _hangs(WELCOME),
    "acknowledges what nobody sent": _acknowledges_others,
    "closes at each message": _closes_at_a_message,
    "welcomes and closes": _says(WELCOME),
    "a message that is none": _hangs(WELCOME + bytes([PUBLISH << 4 | 2, 3, 0, 9, 65])),
    "a topic that is no text": _hangs(WELCOME + bytes([PUBLISH << 4, 4, 0, 2, 0xFF, 0xFE])),
}


@dataclass
class BadBroker:
    """A broker that behaves once `manner` is None.

    Attributes:
        manner: how connections are treated.
        connections: how many there were.
        taken: payloads that were acknowledged, as they came.
        poison: payloads at which it closes the connection.
        ignored: payloads that it never acknowledges.
    """

    manner: Manner | None = None
    connections: int = 0
    taken: list[bytes] = field(default_factory=list)
    poison: frozenset[bytes] = frozenset()
    ignored: frozenset[bytes] = frozenset()
    port: int = 0

    async def serve(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        """Treat one connection."""
        self.connections += 1
        with suppress(OSError, asyncio.IncompleteReadError):
            try:
                await (self.manner or _behave)(self, reader, writer)
            finally:
                writer.close()

    def acknowledge(self, content: bytes, writer: Writer) -> None:
        """Take a message of quality of service 1."""
        length = int.from_bytes(content[:2], "big")
        topic, number = content[2 : 2 + length], content[2 + length : 4 + length]
        if not topic.endswith(b"/online"):
            self.taken.append(content[4 + length :])
        writer.write(bytes([PUBACK << 4, 2, *number]))


async def _behave(broker: BadBroker, reader: asyncio.StreamReader, writer: Writer) -> None:
    while True:
        kind, content = await read_packet(reader)
        match kind >> 4:
            case 1:
                writer.write(WELCOME)
            case 3 if any(content.endswith(each) for each in broker.poison):
                return
            case 3 if not any(content.endswith(each) for each in broker.ignored):
                broker.acknowledge(content, writer)
            case 8:
                writer.write(bytes([SUBACK << 4, 3, *content[:2], 1]))
            case 12:
                writer.write(bytes([PONG << 4, 0]))


@asynccontextmanager
async def serving(port: int = 0) -> AsyncIterator[BadBroker]:
    """A broker for as long as the context lasts."""
    broker = BadBroker()
    served: set[asyncio.Task[None]] = set()

    def meet(reader: asyncio.StreamReader, writer: Writer) -> None:
        task = asyncio.ensure_future(broker.serve(reader, writer))
        served.add(task)
        task.add_done_callback(served.discard)

    server = await asyncio.start_server(meet, "127.0.0.1", port)
    broker.port = server.sockets[0].getsockname()[1]
    try:
        yield broker
    finally:
        server.close()
        for task in tuple(served):
            task.cancel()
        await asyncio.gather(*served, return_exceptions=True)
        await server.wait_closed()
