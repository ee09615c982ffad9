"""Hostile devices: no crash, no wrong value believed, and a good reply right after."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress

import pytest

from drivers.modbus.link import ModbusLink
from drivers.modbus.registers import ReadRequest, RegisterConfig
from edge_service.messages.samples import Quality

REQUEST = ReadRequest(3, 0, 2, (RegisterConfig(channel="torque_command_nm", address=0),))
WORDS = (0x4049, 0x0FDB)
PATIENCE_S = 60.0
Answer = Callable[[bytes], Sequence[bytes | None]]
"""Bytes of a request -> pieces that are sent back; None hangs up."""


def good(packet: bytes) -> list[bytes]:
    return [packet[:2] + struct.pack(">HHBBB2H", 0, 7, packet[6], packet[7], 4, *WORDS)]


class Peer:
    """A device that answers as it is told; `connections` counts the clients it has seen."""

    def __init__(self) -> None:
        self.answer: Answer = good
        self.connections = self.port = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        with suppress(OSError, EOFError):
            while True:
                packet = await reader.readexactly(12)
                for piece in self.answer(packet):
                    if piece is None:
                        raise EOFError
                    writer.write(piece)
                    await writer.drain()
        writer.close()


@pytest.fixture
async def peer() -> AsyncIterator[Peer]:
    made = Peer()
    server = await asyncio.start_server(made.serve, "127.0.0.1", 0)
    made.port = server.sockets[0].getsockname()[1]
    yield made
    server.close()
    await server.wait_closed()


@pytest.fixture
async def link(peer: Peer) -> AsyncIterator[ModbusLink]:
    made = ModbusLink("127.0.0.1", peer.port, 1, PATIENCE_S)
    await made.connect()
    yield made
    made.close()


def reply(rest: str) -> Answer:
    return lambda packet: [packet[:2] + bytes.fromhex(rest)]


HOSTILE: dict[str, tuple[Answer, Quality]] = {
    "hangs up": (lambda _: [None], Quality.NO_REPLY),
    "cut off": (lambda p: [good(p)[0][:-1], None], Quality.NO_REPLY),
    "one byte": (lambda _: [b"\x00", None], Quality.NO_REPLY),
    "another transaction": (lambda p: [b"\x99\x99" + good(p)[0][2:], None], Quality.NO_REPLY),
    "transaction zero": (lambda p: [b"\0\0" + good(p)[0][2:], None], Quality.NO_REPLY),
    "echo": (lambda p: [p], Quality.MALFORMED),
    "another unit": (reply("0000 0007 09 03 04 4049 0fdb"), Quality.MALFORMED),
    "another function": (reply("0000 0007 01 04 04 4049 0fdb"), Quality.MALFORMED),
    "exception of another function": (reply("0000 0003 01 84 02"), Quality.MALFORMED),
    "exception too long": (reply("0000 0004 01 83 02 00"), Quality.MALFORMED),
    "one register too few": (reply("0000 0005 01 03 02 4049"), Quality.MALFORMED),
    "one register too many": (reply("0000 0009 01 03 06 4049 0fdb 0000"), Quality.MALFORMED),
    "byte count too small": (reply("0000 0007 01 03 02 4049 0fdb"), Quality.MALFORMED),
    "half a register more": (reply("0000 0008 01 03 05 4049 0fdb 00"), Quality.MALFORMED),
    "exception": (reply("0000 0003 01 83 02"), Quality.DEVICE_EXCEPTION),
}


@pytest.mark.parametrize("name", HOSTILE)
async def test_a_hostile_reply_is_no_value_and_the_next_read_is_good(
    name: str, peer: Peer, link: ModbusLink
) -> None:
    peer.answer, quality = HOSTILE[name]
    bad = await link.read(REQUEST)
    assert (bad.quality, bad.words) == (quality, ())
    assert bad.problem
    assert link.connected == (quality is Quality.DEVICE_EXCEPTION)
    peer.answer = good
    if not link.connected:
        await link.connect()
    fine = await link.read(REQUEST)
    assert (fine.quality, fine.words) == (Quality.GOOD, WORDS)
    assert fine.sent_s <= fine.received_s


HARMLESS: dict[str, Answer] = {
    "byte by byte": lambda p: [bytes([byte]) for byte in good(p)[0]],
    "merged with a late reply": lambda p: [b"\x77\x77" + good(p)[0][2:] + good(p)[0]],
    "twice": lambda p: good(p) * 2,
    "unit 0, as devices without a gateway may": reply("0000 0007 00 03 04 4049 0fdb"),
    "unit 255": reply("0000 0007 ff 03 04 4049 0fdb"),
}


@pytest.mark.parametrize("name", HARMLESS)
async def test_what_holds_a_whole_reply_is_read(name: str, peer: Peer, link: ModbusLink) -> None:
    peer.answer = HARMLESS[name]
    for _ in range(5):
        assert (await link.read(REQUEST)).words == WORDS
    assert peer.connections == 1


ENDLESS: dict[str, Answer] = {
    "garbage": lambda _: [bytes(range(256))],
    "another protocol": reply("0001 0007 01 03 04 4049 0fdb"),
    "length zero": reply("0000 0000 01 03 04 4049 0fdb"),
    "endless length": reply("0000 ffff 01 03 04 4049 0fdb"),
    "more than any reply": lambda _: [bytes([1]) * 400],
}


@pytest.mark.parametrize("name", ENDLESS)
async def test_bytes_that_become_no_reply_are_malformed_when_time_is_over(
    name: str, peer: Peer
) -> None:
    peer.answer = ENDLESS[name]
    link = ModbusLink("127.0.0.1", peer.port, 1, 0.2)
    await link.connect()
    bad = await link.read(REQUEST)
    assert (bad.quality, bad.words, link.connected) == (Quality.MALFORMED, (), False)


async def test_a_device_that_hangs_up_after_each_reply_is_asked_on_a_new_connection(
    peer: Peer, link: ModbusLink
) -> None:
    peer.answer = lambda packet: [*good(packet), None]
    for number in range(1, 4):
        assert (await link.read(REQUEST)).words == WORDS
        async with asyncio.timeout(PATIENCE_S):
            while link.connected:
                await asyncio.sleep(0)
        await link.connect()
        assert peer.connections >= number


async def test_silence_is_no_reply_and_close_ends_a_read_at_once(peer: Peer) -> None:
    peer.answer = lambda _: []
    link = ModbusLink("127.0.0.1", peer.port, 1, 0.02)
    await link.connect()
    assert (await link.read(REQUEST)).quality is Quality.NO_REPLY
    link = ModbusLink("127.0.0.1", peer.port, 1, 2.0 * PATIENCE_S)
    await link.connect()
    reading = asyncio.create_task(link.read(REQUEST))
    await asyncio.sleep(0)
    link.close()
    async with asyncio.timeout(PATIENCE_S):
        assert (await reading).quality is Quality.NO_REPLY
    link.close()
