"""Hostile devices: no crash, no wrong value believed, and a good reply right after.

The peer is in the same process: what it writes is received before the request has returned.
"""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable, Sequence

import pytest
from pymodbus.transport import CommParams, CommType, ModbusProtocol
from pymodbus.transport.transport import NULLMODEM_HOST, NullModem

from drivers.modbus.link import ModbusLink
from drivers.modbus.registers import ReadRequest, RegisterConfig
from edge_service.messages.samples import Quality

REGISTER = RegisterConfig(channel="torque_command_nm", address=0)
REQUEST = ReadRequest(3, 0, 2, (REGISTER,))
WORDS = [0x4049, 0x0FDB]
Answer = Callable[[bytes], Sequence[bytes | None]]
"""Bytes of a request -> pieces that are sent back; None hangs up."""


def good(packet: bytes) -> list[bytes]:
    return [packet[:2] + struct.pack(">HHBBB2H", 0, 7, packet[6], packet[7], 4, *WORDS)]


class Peer(ModbusProtocol):
    """A device that answers as it is told; `connections` counts the clients it has seen."""

    def __init__(self, listener: "Peer | None" = None) -> None:
        port = ("127.0.0.1", 502) if listener is None else None
        params = CommParams(CommType.TCP.name, CommType.TCP, source_address=port)
        params.source_address = (NULLMODEM_HOST, 502)
        super().__init__(params, is_server=True)
        self.answer: Answer = good
        self.connections = 0
        self._root = listener
        self.latest: Peer | None = None

    def callback_new_connection(self) -> ModbusProtocol:
        self.connections += 1
        self.latest = Peer(self)
        return self.latest

    def callback_connected(self) -> None:
        pass

    def callback_disconnected(self, exc: Exception | None) -> None:
        pass

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        assert self._root is not None
        for piece in self._root.answer(data):
            if piece is None:
                self.transport.close()
            elif self.transport is not None:
                self.send(piece)
        return len(data)


@pytest.fixture
async def peer() -> AsyncIterator[Peer]:
    listening = Peer()
    await listening.listen()
    yield listening
    listening.close()
    assert not NullModem.is_dirty()


@pytest.fixture
async def link(peer: Peer) -> AsyncIterator[ModbusLink]:
    made = ModbusLink(NULLMODEM_HOST, 502, 1, 0.02)
    yield made
    made.close()


def reply(transaction: bytes, rest: str) -> bytes:
    return transaction + bytes.fromhex(rest)


HOSTILE: dict[str, tuple[Answer, Quality]] = {
    "silence": (lambda _: [], Quality.NO_REPLY),
    "hangs up": (lambda _: [None], Quality.NO_REPLY),
    "cut off": (lambda p: [good(p)[0][:-1]], Quality.NO_REPLY),
    "one byte": (lambda _: [b"\x00"], Quality.NO_REPLY),
    "wrong transaction": (lambda p: [b"\x99\x99" + good(p)[0][2:]], Quality.NO_REPLY),
    "another unit": (lambda p: [reply(p[:2], "0000 0007 09 03 04 4049 0fdb")], Quality.MALFORMED),
    "garbage": (lambda _: [bytes(range(256))], Quality.MALFORMED),
    "never ending": (lambda _: [b"\x00\x09\x00\x00\x00\xfe\x01\x03\xfa"] * 200, Quality.NO_REPLY),
    "echo": (lambda p: [p], Quality.MALFORMED),
    "exception": (lambda p: [reply(p[:2], "0000 0003 01 83 02")], Quality.DEVICE_EXCEPTION),
}


@pytest.mark.parametrize("name", HOSTILE)
async def test_a_hostile_reply_is_no_value_and_the_next_read_is_good(
    name: str, peer: Peer, link: ModbusLink
) -> None:
    answer, quality = HOSTILE[name]
    await link.connect()
    for _ in range(3):
        peer.answer = answer
        bad = await link.read(REQUEST)
        assert bad.quality is quality
        assert bad.words == []
        assert bad.problem
        assert link.connected == (quality is Quality.DEVICE_EXCEPTION)
        peer.answer = good
        await link.connect()
        fine = await link.read(REQUEST)
        assert fine.quality is Quality.GOOD
        assert fine.words == WORDS


HARMLESS: dict[str, Answer] = {
    "byte by byte": lambda p: [bytes([byte]) for byte in good(p)[0]],
    "after a late reply": lambda p: [b"\x77\x77" + good(p)[0][2:], *good(p)],
    "merged with a late reply": lambda p: [b"\x77\x77" + good(p)[0][2:] + good(p)[0]],
    "twice": lambda p: good(p) * 2,
    "with rubbish behind": lambda p: [good(p)[0] + b"\xff" * 20],
}


@pytest.mark.parametrize("name", HARMLESS)
async def test_what_still_holds_a_whole_reply_is_read(
    name: str, peer: Peer, link: ModbusLink
) -> None:
    peer.answer = HARMLESS[name]
    await link.connect()
    for _ in range(5):
        read = await link.read(REQUEST)
        assert read.words == WORDS
    assert peer.connections == 1


async def test_close_ends_a_read_at_once(peer: Peer) -> None:
    link = ModbusLink(NULLMODEM_HOST, 502, 1, 30.0)
    peer.answer = lambda _: []
    await link.connect()
    reading = asyncio.create_task(link.read(REQUEST))
    await asyncio.sleep(0)
    link.close()
    async with asyncio.timeout(5.0):
        assert (await reading).quality is Quality.NO_REPLY
    link.close()


async def test_the_midpoint_lies_between_request_and_reply(peer: Peer, link: ModbusLink) -> None:
    loop = asyncio.get_running_loop()
    await link.connect()
    before_s = loop.time()
    read = await link.read(REQUEST)
    assert before_s <= read.sent_s <= read.midpoint_s <= read.received_s <= loop.time()
    assert read.midpoint_s == pytest.approx(0.5 * (read.sent_s + read.received_s))


async def test_a_cancellation_that_comes_with_the_reply_is_heeded(peer: Peer) -> None:
    """In Python 3.11 the library's `wait_for` hands out the reply and forgets the cancellation."""
    link = ModbusLink(NULLMODEM_HOST, 502, 1, 5.0)
    packets: list[bytes] = []
    peer.answer = lambda packet: packets.append(packet) or []  # type: ignore[func-returns-value]
    await link.connect()
    reading = asyncio.create_task(link.read(REQUEST))
    while not packets:
        await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert peer.latest is not None
    peer.latest.send(good(packets[0])[0])
    reading.cancel()
    with pytest.raises(asyncio.CancelledError):
        await reading
    assert not link.connected
