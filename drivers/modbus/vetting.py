"""Vetting of received bytes as the reply to a request: checks that the library does not make.

It takes a reply of another function code, with another number of registers, with transaction id 0
or with bytes left over, and it fails with a traceback in the event loop where a reply cannot be
decoded. Modbus messaging on TCP/IP 1.0b, 3.1.3: transaction, protocol (0), length, unit; then
function, byte count and registers, or function + 0x80 and an exception code.
"""

import struct
from dataclasses import dataclass
from enum import Enum

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
                return _whole(received[start:end], asked, function)
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


def _whole(reply: bytes, asked: Asked, function: int) -> Judgement:
    announced = reply[_HEADER.size]
    if function == asked.function and announced != 2 * asked.count:
        problem = f"{announced} bytes announced for {asked.count} registers"
        return Judgement(Verdict.WRONG, problem)
    return Judgement(Verdict.REPLY, reply=reply)
