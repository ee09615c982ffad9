"""One connection to one device: requests out, replies in, vetted where the library does not.

It takes a reply of another function code, with another number of registers, with transaction id 0
or with bytes left over, and it fails with a traceback in the event loop where a reply cannot be
decoded. Modbus messaging on TCP/IP 1.0b, 3.1.3: transaction, protocol (0), length, unit; then
function, byte count and registers, or function + 0x80 and an exception code.
"""

import asyncio
import logging
import struct
from dataclasses import dataclass
from enum import Enum

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from edge_service.cancellation import heed_cancellation
from edge_service.messages.quality import Quality

from ..base import DriverUnavailableError
from .registers import FUNCTION_OF, ReadRequest

# What the library finds wrong with a frame is passed on in the quality of the samples, once.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
_HEADER = struct.Struct(">HHHBB")
_BEFORE_LENGTH = 6
_LONGEST = 254
"""Unit and longest protocol data unit."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Read request that was sent: transaction id, unit, function code, number of registers."""

    transaction: int
    unit: int
    function: int
    count: int

    @classmethod
    def of_packet(cls, packet: bytes) -> "Asked":
        """Question in the bytes of a read request."""
        transaction, _, _, unit, function = _HEADER.unpack_from(packet)
        return cls(transaction, unit, function, int.from_bytes(packet[10:12], "big"))


class Verdict(Enum):
    """Verdict on the bytes received so far."""

    INCOMPLETE = "incomplete"
    REPLY = "reply"
    WRONG = "wrong"


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict, in words what is wrong, and the bytes of the reply alone."""

    verdict: Verdict
    problem: str = ""
    reply: bytes = b""


def vet(received: bytes, asked: Asked) -> Judgement:
    """Judge the bytes received since the request.

    Whole frames of other transactions are passed over: an earlier request may be answered late.
    """
    start = 0
    while len(received) - start >= _HEADER.size:
        transaction, protocol, length, unit, function = _HEADER.unpack_from(received, start)
        if protocol != 0 or not 3 <= length <= _LONGEST:
            return Judgement(
                Verdict.WRONG, f"no Modbus frame: protocol {protocol}, length {length}"
            )
        end = start + _BEFORE_LENGTH + length
        if transaction == asked.transaction:
            problem = _contradiction(asked, unit, function, length)
            if problem:
                return Judgement(Verdict.WRONG, problem)
            if len(received) >= end:
                announced = received[start + _HEADER.size]
                if function == asked.function and announced != 2 * asked.count:
                    problem = f"{announced} bytes announced for {asked.count} registers"
                    return Judgement(Verdict.WRONG, problem)
                return Judgement(Verdict.REPLY, reply=received[start:end])
        if len(received) < end:
            break
        start = end
    return Judgement(Verdict.INCOMPLETE)


def _contradiction(asked: Asked, unit: int, function: int, length: int) -> str:
    if unit != asked.unit:
        return f"a reply of unit {unit} to a request to unit {asked.unit}"
    if function == asked.function | 0x80:
        return "" if length == 3 else f"an exception of length {length}"
    if function != asked.function:
        return f"a reply with function {function} to a request with function {asked.function}"
    if length != 3 + 2 * asked.count:
        return f"a reply of length {length} to a request for {asked.count} registers"
    return ""


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of one read.

    Attributes:
        words: the registers; empty unless `quality` is good.
        quality: why there are none.
        problem: the same in words.
        sent_s, received_s: on the event loop's clock.
    """

    words: list[int]
    quality: Quality
    problem: str
    sent_s: float
    received_s: float

    @property
    def midpoint_s(self) -> float:
        """Time at which the device read its registers: half way between request and reply."""
        return 0.5 * (self.sent_s + self.received_s)


class ModbusLink:
    """A connection that is made when it is needed and let go after a reply that cannot be trusted.

    A stream that was once out of step, or a reply that may still be under way, must not be read as
    the answer to the next request, so nothing but a new connection follows.
    """

    def __init__(self, host: str, port: int, device_id: int, timeout_s: float) -> None:
        self._host, self._port = host, port
        self._device_id = device_id
        self._timeout_s = timeout_s
        self._client: AsyncModbusTcpClient | None = None
        self._asked: Asked | None = None

    @property
    def connected(self) -> bool:
        """True while the connection is up."""
        return self._client is not None and self._client.connected

    async def connect(self) -> None:
        """Connect unless connected. Raises DriverUnavailableError."""
        if self.connected:
            return
        self.close()
        client = AsyncModbusTcpClient(
            self._host,
            port=self._port,
            timeout=self._timeout_s,
            retries=0,
            reconnect_delay=0,
            trace_packet=self._vet,
            trace_connect=self._note_connection,
        )
        self._client = client
        try:
            reached = await client.connect()
            heed_cancellation()
        except BaseException:
            self._let_go(client)
            raise
        if not reached or self._client is not client:
            self._let_go(client)
            raise DriverUnavailableError(f"{self._host}:{self._port}: no connection")

    async def read(self, request: ReadRequest) -> Reply:
        """One read; every way in which it can fail is a quality. Raises nothing but cancellation.

        After anything but registers or an exception of the device the connection is gone.
        """
        loop = asyncio.get_running_loop()
        sent_s = loop.time()
        client = self._client
        if client is None:
            return Reply([], Quality.NO_REPLY, "not connected", sent_s, sent_s)
        try:
            response = await self._ask(client, request)
            heed_cancellation()
        except (ModbusException, OSError) as error:
            malformed = isinstance(error, _WrongReplyError)
            quality = Quality.MALFORMED if malformed else Quality.NO_REPLY
            problem = str(error) if malformed else "no reply"
            self._let_go(client)
            return Reply([], quality, problem, sent_s, loop.time())
        except BaseException:
            self._let_go(client)
            raise
        received_s = loop.time()
        if response.isError():
            problem = f"exception {response.exception_code}"
            return Reply([], Quality.DEVICE_EXCEPTION, problem, sent_s, received_s)
        return Reply(list(response.registers), Quality.GOOD, "", sent_s, received_s)

    def close(self) -> None:
        """Let go of the connection; a read that is under way ends at once. Safe twice."""
        if self._client is not None:
            self._let_go(self._client)

    async def _ask(self, client: AsyncModbusTcpClient, request: ReadRequest) -> ModbusPDU:
        read = (
            client.read_holding_registers
            if request.function == FUNCTION_OF["holding"]
            else client.read_input_registers
        )
        return await read(request.address, count=request.count, device_id=self._device_id)

    def _vet(self, sending: bool, packet: bytes) -> bytes:
        """Bytes that the library may see: a whole reply to the request, or nothing yet."""
        if sending:
            self._asked = Asked.of_packet(packet)
            return packet
        if self._asked is None:
            return b""
        judgement = vet(packet, self._asked)
        if judgement.verdict is Verdict.WRONG:
            self._fail(_WrongReplyError(judgement.problem))
        if judgement.verdict is not Verdict.INCOMPLETE:
            self._asked = None
        return judgement.reply

    def _note_connection(self, connected: bool) -> None:
        if not connected:
            self._fail(OSError("the device closed the connection"))

    def _fail(self, error: Exception) -> None:
        """End the read that is under way, if any, instead of waiting for its time to run out."""
        waiting = self._client.ctx.response_future if self._client else None
        if self._asked is not None and waiting is not None and not waiting.done():
            waiting.set_exception(error)
        self._asked = None

    def _let_go(self, client: AsyncModbusTcpClient) -> None:
        self._fail(OSError("closed"))
        if isinstance(client.ctx.transport, asyncio.WriteTransport):
            client.ctx.transport.abort()
        client.close()
        if self._client is client:
            self._client = None


class _WrongReplyError(ModbusException):
    """Bytes that are no reply to the request."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problem = problem

    def __str__(self) -> str:
        return self.problem
