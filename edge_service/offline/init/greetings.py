"""Devices found by their first answer: one request of each protocol, on ports where it is usual.

Sources: MODBUS Messaging on TCP/IP V1.0b (MBAP header); OPC UA part 6, 7.1.2 (Hello); MQTT 3.1.1,
3.1 (CONNECT).
"""

import asyncio
import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

WAIT_S = 1.0
"""For a connection, and for the answer."""
_HELLO_URL = b"opc.tcp://localhost:4840"
_HELLO = struct.pack("<6I", 0, 65_536, 65_536, 0, 0, len(_HELLO_URL)) + _HELLO_URL


@dataclass(frozen=True, slots=True)
class Greeting:
    """First request of a protocol, how its answers begin, and the ports where it is usual."""

    ports: tuple[int, ...]
    request: bytes
    answers: tuple[bytes, ...]


GREETINGS = {
    "modbus": Greeting((502, 5020), bytes.fromhex("000100000006010300000001"), (b"\0\1\0\0",)),
    "opc.tcp": Greeting(
        (4840,), b"HELF" + struct.pack("<I", 8 + len(_HELLO)) + _HELLO, (b"ACKF", b"ERRF")
    ),
    "mqtt": Greeting((1883,), b"\x10\x0c\0\4MQTT\4\2\0\x0a\0\0", (b"\x20\2",)),
}


async def find_devices(host: str, port: int | None = None) -> list[str]:
    """Addresses `protocol://host:port` at which a device of a known protocol answers.

    Args:
        port: is greeted in every protocol; without it every protocol on its usual ports.
    """
    tried = [
        (protocol, each)
        for protocol, greeting in GREETINGS.items()
        for each in (greeting.ports if port is None else (port,))
    ]
    answers = await asyncio.gather(*(_answers(host, each, GREETINGS[name]) for name, each in tried))
    shown = f"[{host}]" if ":" in host else host
    found = zip(tried, answers, strict=True)
    return [f"{protocol}://{shown}:{each}" for (protocol, each), yes in found if yes]


def usual_ports() -> str:
    """Protocols with their usual ports, for people."""
    return ", ".join(f"{name} {_listed(each.ports)}" for name, each in GREETINGS.items())


def _listed(ports: Sequence[int]) -> str:
    return " or ".join(map(str, ports))


async def _answers(host: str, port: int, greeting: Greeting) -> bool:
    """True if a device there answers as the protocol has it."""
    with suppress(OSError, TimeoutError):
        async with asyncio.timeout(WAIT_S):
            reader, writer = await asyncio.open_connection(host, port)
        try:
            writer.write(greeting.request)
            async with asyncio.timeout(WAIT_S):
                return (await reader.read(16)).startswith(greeting.answers)
        finally:
            writer.close()
    return False
