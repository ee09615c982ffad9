"""One connection to one device: read requests out, replies in, believed where every field agrees.

Modbus messaging on TCP/IP 1.0b, 3.1.3: transaction, protocol (0), length, unit; then function,
byte count and registers, or function + 0x80 and an exception code.
"""

import asyncio
import struct
from dataclasses import dataclass

from edge_service.messages.samples import Quality

from ..base import DriverUnavailableError
from .registers import ReadRequest

_HEADER = struct.Struct(">HHHB")
_LONGEST = 254
"""Unit and longest protocol data unit."""


class WrongReplyError(Exception):
    """Bytes that are no reply to the request; the text says why."""


class RefusedError(Exception):
    """An exception of the device; the text is its code."""


@dataclass(frozen=True, slots=True)
class Reply:
    """Outcome of one read.

    Attributes:
        words: the registers; empty unless `quality` is good.
        quality: why there are none.
        problem: the same in words.
        sent_s, received_s: on the event loop's clock.
    """

    words: tuple[int, ...]
    quality: Quality
    problem: str
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

    @property
    def connected(self) -> bool:
        """True until the connection is let go, or its end has been noticed."""
        return self._stream is not None and not self._stream[1].is_closing()

    async def connect(self) -> None:
        """Connect anew. Raises DriverUnavailableError."""
        self.close()
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
        except RefusedError as error:
            quality, problem, kept = Quality.DEVICE_EXCEPTION, f"exception {error}", True
        except WrongReplyError as error:
            quality, problem = Quality.MALFORMED, str(error)
        except (OSError, EOFError):
            quality, problem = Quality.NO_REPLY, "no reply"
        finally:
            if not kept:
                self.close()
        return Reply(words, quality, problem, sent_s, loop.time())

    def close(self) -> None:
        """Let go of the connection; a read that is under way ends at once. Safe twice."""
        stream, self._stream = self._stream, None
        if stream is not None:
            stream[1].transport.abort()

    async def _ask(self, request: ReadRequest) -> tuple[int, ...]:
        """The registers. Raises WrongReplyError, RefusedError, OSError and EOFError."""
        if self._stream is None:
            raise EOFError
        reader, writer = self._stream
        self._transaction = self._transaction % 0xFFFF + 1
        function, count = request.function, request.count
        header = _HEADER.pack(self._transaction, 0, 6, self._unit)
        writer.write(header + struct.pack(">BHH", function, request.address, count))
        while True:
            header = await reader.readexactly(_HEADER.size)
            transaction, protocol, length, unit = _HEADER.unpack(header)
            if protocol != 0 or not 3 <= length <= _LONGEST:
                raise WrongReplyError(f"no Modbus frame: protocol {protocol}, length {length}")
            content = await reader.readexactly(length - 1)
            if transaction == self._transaction:  # or an earlier request is answered late
                break
        if unit != self._unit:
            raise WrongReplyError(f"a reply of unit {unit} to a request to unit {self._unit}")
        if content[0] == function | 0x80 and len(content) == 2:
            raise RefusedError(content[1])
        if content[0] != function:
            raise WrongReplyError(f"a reply with function {content[0]} to {function}")
        if len(content) != 2 + 2 * count or content[1] != 2 * count:
            raise WrongReplyError(f"a reply of {len(content)} bytes to {count} registers")
        return struct.unpack(f">{count}H", content[2:])
