"""One connection to one device: requests out, replies in, believed where every byte agrees.

Frames are the library's; a reply counts if the library writes the same bytes for it, for it reads
some that contradict themselves.
"""

import asyncio
import logging
from dataclasses import dataclass

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from edge_service.messages.samples import Quality

from ..base import DriverUnavailableError
from .registers import ReadRequest

# What the library finds wrong with a frame is passed on in the quality of the samples, once.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
NO_UNITS = (0, 255)
"""Units of a reply from a device that has none, whatever it was asked as."""
_FRAMER = FramerSocket(DecodePDU(is_server=False))
_REQUESTS = {
    each.function_code: each for each in (ReadHoldingRegistersRequest, ReadInputRegistersRequest)
}


class WrongReplyError(Exception):
    """Bytes that are no reply to the request, or an exception of the device; the text says why."""

    quality = Quality.MALFORMED


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of one read."""

    words: tuple[int, ...]  # the registers; empty unless `quality` is good
    quality: Quality  # why there are none
    problem: str  # the same in words
    # sent_s, received_s: on the event loop's clock
    sent_s: float
    received_s: float


class ModbusLink:
    """A connection that is let go after a reply that cannot be trusted, or none.

    What is still under way must not be read as the answer to the next request, so nothing but a
    new connection follows.
    """

    def __init__(self, host: str, port: int, unit: int, timeout_s: float) -> None:
        self._host, self._port, self._unit, self._timeout_s = host, port, unit, timeout_s
        self._stream: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._transaction = 0
        self._received = b""

    @property
    def connected(self) -> bool:
        """Return whether the connection is held, and no end of it has been noticed."""
        if self._stream is None:
            return False
        reader, writer = self._stream
        return not (writer.is_closing() or reader.at_eof())

    async def connect(self) -> None:
        """Connect anew. Raises DriverUnavailableError."""
        self.close()
        self._received = b""
        try:
            async with asyncio.timeout(self._timeout_s):
                self._stream = await asyncio.open_connection(self._host, self._port)
        except OSError:
            raise DriverUnavailableError(f"{self._host}:{self._port}: no connection") from None

    async def read(self, request: ReadRequest) -> Reply:
        """One read; every way in which it can fail is a quality. Raises nothing but cancellation.

        After anything but registers or an exception of the device the connection is gone.
        """
        loop = asyncio.get_running_loop()
        sent_s = loop.time()
        words: tuple[int, ...] = ()
        quality, problem, kept = Quality.GOOD, "", False
        try:
            async with asyncio.timeout(self._timeout_s):
                words = await self._ask(request)
            kept = True
        except WrongReplyError as error:
            quality, problem = error.quality, str(error)
            kept = quality is Quality.DEVICE_EXCEPTION
        except (OSError, EOFError) as error:
            quality, problem = Quality.NO_REPLY, "no reply"
            if isinstance(error, TimeoutError) and self._received:
                quality, problem = Quality.MALFORMED, "bytes that are no reply"
        finally:
            if not kept:
                self.close()
        return Reply(words, quality, problem, sent_s, loop.time())

    def close(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            stream[1].transport.abort()

    async def _ask(self, request: ReadRequest) -> tuple[int, ...]:
        """The registers. Raises WrongReplyError, OSError and EOFError."""
        if self._stream is None:
            raise EOFError
        reader, writer = self._stream
        self._transaction = self._transaction % 0xFFFF + 1
        asked = _REQUESTS[request.function](
            address=request.address,
            count=request.count,
            dev_id=self._unit,
            transaction_id=self._transaction,
        )
        writer.write(_FRAMER.buildFrame(asked))
        while True:
            more = await reader.read(_FRAMER.MAX_SIZE)
            if not more:
                raise EOFError
            self._received += more
            try:  # frames of other transactions are passed over: an earlier request answered late
                used, reply = _FRAMER.handleFrame(self._received, 0, self._transaction)
            except ModbusException as error:
                raise WrongReplyError(error.string) from None
            frame, self._received = self._received[:used], self._received[used:]
            if len(self._received) > _FRAMER.MAX_SIZE:
                raise WrongReplyError("bytes that are no reply")
            if reply is not None and reply.transaction_id == self._transaction:
                break
        if reply.dev_id not in (self._unit, *NO_UNITS):
            raise WrongReplyError(f"a reply of unit {reply.dev_id} to a request to {self._unit}")
        if reply.function_code & 0x7F != request.function or not frame.endswith(
            _FRAMER.buildFrame(reply)
        ):
            raise WrongReplyError(f"a reply that does not fit its request: {frame.hex(' ')}")
        if isinstance(reply, ExceptionResponse):
            refusal = WrongReplyError(f"exception {reply.exception_code}")
            refusal.quality = Quality.DEVICE_EXCEPTION
            raise refusal
        if len(reply.registers) != request.count:
            raise WrongReplyError(f"{len(reply.registers)} registers in place of {request.count}")
        return tuple(reply.registers)
