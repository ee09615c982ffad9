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

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException

from edge_service.messages.samples import Quality
from edge_service.retry import heed_cancellation

from ..base import DriverUnavailableError
from .registers import FUNCTION_OF, ReadRequest

# What the library finds wrong with a frame is passed on in the quality of the samples, once.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
_HEADER = struct.Struct(">HHHBB")
_BEFORE_LENGTH = 6
_LONGEST = 254
"""Unit and longest protocol data unit."""


class WrongReplyError(ModbusException):
    """Bytes that are no reply to the request; the text says why."""

    def __str__(self) -> str:
        return self.string


def vet(received: bytes, asked: bytes) -> bytes:
    """The reply in the bytes received since a read request was sent; empty while it is not whole.

    Whole frames of other transactions are passed over: an earlier request may be answered late.

    Args:
        asked: bytes of the request.

    Raises:
        WrongReplyError: what has come contradicts the request.
    """
    wanted, _, _, to_unit, to_function = _HEADER.unpack_from(asked)
    count = int.from_bytes(asked[10:12], "big")
    start = 0
    while len(received) - start >= _HEADER.size:
        transaction, protocol, length, unit, function = _HEADER.unpack_from(received, start)
        if protocol != 0 or not 3 <= length <= _LONGEST:
            raise WrongReplyError(f"no Modbus frame: protocol {protocol}, length {length}")
        end = start + _BEFORE_LENGTH + length
        if transaction == wanted:
            refused = function == to_function | 0x80
            if unit != to_unit:
                raise WrongReplyError(f"a reply of unit {unit} to a request to unit {to_unit}")
            if function != to_function and not refused:
                raise WrongReplyError(f"a reply with function {function} to {to_function}")
            if length != (3 if refused else 3 + 2 * count):
                raise WrongReplyError(f"a reply of length {length} to {count} registers")
            if len(received) >= end:
                announced = received[start + _HEADER.size]
                if not refused and announced != 2 * count:
                    raise WrongReplyError(f"{announced} bytes announced for {count} registers")
                return received[start:end]
        if len(received) < end:
            break
        start = end
    return b""


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
        self._asked: bytes | None = None

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
        read = (
            client.read_holding_registers
            if request.function == FUNCTION_OF["holding"]
            else client.read_input_registers
        )
        try:
            response = await read(request.address, count=request.count, device_id=self._device_id)
            heed_cancellation()
        except (ModbusException, OSError) as error:
            malformed = isinstance(error, WrongReplyError)
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

    def _vet(self, sending: bool, packet: bytes) -> bytes:
        """Bytes that the library may see: a whole reply to the request, or nothing yet."""
        if sending:
            self._asked = packet
            return packet
        if self._asked is None:
            return b""
        try:
            reply = vet(packet, self._asked)
        except WrongReplyError as error:
            self._fail(error)
            return b""
        if reply:
            self._asked = None
        return reply

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
