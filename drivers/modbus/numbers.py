"""Numbers in 16-bit registers, both ways, in every order that devices use."""

import struct
from collections.abc import Sequence

from .config import NumberType, Order

_FORMATS: dict[NumberType, str] = {
    "int16": ">h",
    "uint16": ">H",
    "int32": ">i",
    "uint32": ">I",
    "int64": ">q",
    "uint64": ">Q",
    "float32": ">f",
    "float64": ">d",
}
_LIMITS: dict[NumberType, tuple[int, int]] = {
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "int64": (-(2**63), 2**63 - 1),
    "uint64": (0, 2**64 - 1),
}


def decode_number(
    words: Sequence[int], kind: NumberType, word_order: Order = "big", byte_order: Order = "big"
) -> float:
    """The number in as many registers as `kind` takes; first register first."""
    ordered = words if word_order == "big" else words[::-1]
    raw = struct.pack(f"{'>' if byte_order == 'big' else '<'}{len(words)}H", *ordered)
    return float(struct.unpack(_FORMATS[kind], raw)[0])


def encode_number(
    value: float, kind: NumberType, word_order: Order = "big", byte_order: Order = "big"
) -> list[int]:
    """Registers that hold a number; an integer type takes the nearest one that it can hold."""
    if kind in _LIMITS:
        low, high = _LIMITS[kind]
        raw = struct.pack(_FORMATS[kind], min(max(round(value), low), high))
    else:
        raw = struct.pack(_FORMATS[kind], value)
    words = struct.unpack(f"{'>' if byte_order == 'big' else '<'}{len(raw) // 2}H", raw)
    return list(words if word_order == "big" else words[::-1])
