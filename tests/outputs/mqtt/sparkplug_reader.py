"""A reader of Sparkplug B from its specification alone: fields by their numbers (chapter 6.4)."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

REBIRTH_COMMAND = b"\x12\x1a\x0a\x14Node Control/Rebirth\x20\x0b\x70\x01"


@dataclass(frozen=True)
class Payload:
    values: dict[str, Any]
    seq: int | None


def fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and raw value of the fields of a message of Protocol Buffers (wire types 0, 1, 2)."""

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at, value, shift = at + 1, value | (byte & 0x7F) << shift, shift + 7
            if not byte & 0x80:
                return value

    at = 0
    while at < len(data):
        key = varint()
        number, wire = key >> 3, key & 7
        if wire == 0:
            yield number, varint()
        elif wire == 1:
            yield number, struct.unpack_from("<d", data, at)[0]
            at += 8
        else:
            assert wire == 2
            length = varint()
            yield number, data[at : at + length]
            at += length


def decode(data: Any) -> Payload:
    """A payload; each metric holds a time and a type, and one value or none."""
    values, seq = {}, None
    for number, value in fields(data):
        if number == 3:
            seq = value
        if number != 2:
            continue
        metric = dict(fields(value))
        assert {1, 3, 4} <= metric.keys()
        held = set(metric) - {1, 3, 4}
        assert len(held) == 1
        place = held.pop()
        assert {7: True, 11: metric[4] == 4, 13: metric[4] == 10, 14: metric[4] == 11}.get(
            place, metric[4] == 12
        )
        raw = metric[place]
        shown = {7: None, 14: bool(raw)}.get(place, raw.decode() if place == 15 else raw)
        values[metric[1].decode()] = shown
    return Payload(values, seq)


def rebirth() -> bytes:
    """A host's command to be born again."""
    return REBIRTH_COMMAND
