"""Register map of a Modbus device: what a user sets, numbers in registers, requests for them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator
from pymodbus.client.mixin import ModbusClientMixin

from ..base import DriverConfig
from ..signals import JOINT_CHANNELS, SignalConfig, check_channels, ends

Order = Literal["big", "little"]
Table = Literal["holding", "input"]
FUNCTION_OF: dict[Table, int] = {"holding": 3, "input": 4}
NumberType = Literal["int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
REGISTERS = 65_536
USUAL_PORT, MOST_UNITS = 502, 255
MOST_REGISTERS = 125
"""Of one request (Modbus application protocol 1.1b3, 6.3)."""


class RegisterConfig(SignalConfig):
    """One value of the map. It becomes a channel, or it guards the others of its group."""

    address: int = Field(ge=0, lt=REGISTERS)  # of its first register, counted from 0
    table: Table = "holding"  # holding registers (function 3) or input registers (function 4)
    type: NumberType = "float32"  # of the number
    group: str | None = None  # poll group; the first one unless given
    word_order: Order | None = None  # the device's unless given
    # no channel but a constant: where it reads otherwise, map or word order is wrong
    equals: float | None = None
    # no channel but a counter: while it rests, the device repeats old values
    heartbeat: bool = False

    @model_validator(mode="after")
    def _one_role(self) -> "RegisterConfig":
        roles = [self.channel is not None, self.equals is not None, self.heartbeat]
        if sum(roles) != 1:
            raise ValueError("expected exactly one of channel, equals and heartbeat = true")
        if self.address + self.words > REGISTERS:
            raise ValueError(f"address {self.address}: {self.type} ends beyond register 65535")
        return self

    @property
    def words(self) -> int:
        return _type(self.type).value[1]


class ModbusConfig(DriverConfig):
    """Settings of the Modbus driver; `deploy/drivers/modbus.toml` tells of each."""

    url: str  # `modbus://HOST:PORT/UNIT` of the device or gateway, and the unit behind it
    timeout_s: float = Field(0.5, gt=0.0, le=30.0)  # for a connection and for each reply
    word_order: Order = "big"
    byte_order: Order = "big"
    poll_groups: dict[str, float] = Field(min_length=1)
    registers: tuple[RegisterConfig, ...] = Field(min_length=1)  # the map

    @field_validator("url")
    @classmethod
    def _is_a_device(cls, value: str) -> str:
        parts = urlsplit(value)
        unit = parts.path.strip("/") or "1"
        if parts.scheme != "modbus" or not parts.hostname or not unit.isdecimal():
            raise ValueError("expected modbus://HOST:PORT/UNIT, such as modbus://192.168.0.5:502/1")
        if parts.port == 0 or int(unit) > MOST_UNITS:
            raise ValueError(f"expected a port above 0 and a unit up to {MOST_UNITS}")
        return value

    @model_validator(mode="after")
    def _check_map(self) -> "ModbusConfig":
        for name, period_s in self.poll_groups.items():
            if not 1e-4 <= period_s <= 3600.0:
                raise ValueError(f"poll_groups.{name}: {period_s:g} s, expected 0.0001 to 3600")
        for number, register in enumerate(self.registers):
            if register.group is not None and register.group not in self.poll_groups:
                problem = f"{register.group!r} is not one of {', '.join(self.poll_groups)}"
                raise ValueError(f"registers[{number}].group: {problem}")
        check_channels("registers", self.registers)
        # two channels in part of the same registers: one of them reads nonsense
        read = [(n, each) for n, each in enumerate(self.registers) if each.channel is not None]
        read.sort(key=lambda pair: (pair[1].table, pair[1].address))
        for (first, low), (second, high) in pairwise(read):
            if low.table == high.table and high.address < low.address + low.words:
                raise ValueError(
                    f"registers[{second}].address: {high.address} is inside registers[{first}], "
                    f"whose {low.type} takes {low.words} from {low.address}"
                )
        for number, register in enumerate(self.registers):
            joint = register.channel in JOINT_CHANNELS
            if joint and self.group_of(register) != self.fastest_group:
                raise ValueError(
                    f"registers[{number}].group: {register.channel} makes the rows and must be in "
                    f"the fastest group, {self.fastest_group!r}"
                )
        return self

    @property
    def endpoint(self) -> tuple[str, int, int]:
        """Host, port and unit."""
        parts = urlsplit(self.url)
        return parts.hostname or "", parts.port or USUAL_PORT, int(parts.path.strip("/") or 1)

    @property
    def address(self) -> str:
        """The same in words."""
        return "{}:{} unit {}".format(*self.endpoint)

    @property
    def fastest_s(self) -> float:
        """Period of the rows."""
        return self.poll_groups[self.fastest_group]

    @property
    def fastest_group(self) -> str:
        """The group that makes the rows."""
        return min(self.poll_groups, key=lambda name: self.poll_groups[name])

    def group_of(self, register: RegisterConfig) -> str:
        return register.group or next(iter(self.poll_groups))


def decode_number(
    words: Sequence[int], kind: NumberType, word_order: Order = "big", byte_order: Order = "big"
) -> float:
    """The number in as many registers as `kind` takes; first register first."""
    ordered = _swapped(words, byte_order)
    number: Any = ModbusClientMixin.convert_from_registers(ordered, _type(kind), word_order)
    return float(number)


def encode_number(
    value: float, kind: NumberType, word_order: Order = "big", byte_order: Order = "big"
) -> list[int]:
    """Registers that hold a number; an integer type takes the nearest one that it can hold."""
    low, high = ends(kind)
    number = value if kind.startswith("float") else round(min(max(value, low), high))
    words = ModbusClientMixin.convert_to_registers(number, _type(kind), word_order)
    return _swapped(words, byte_order)


def _type(kind: NumberType) -> ModbusClientMixin.DATATYPE:
    return ModbusClientMixin.DATATYPE[kind.upper()]


def _swapped(words: Sequence[int], byte_order: Order) -> list[int]:
    return [int.from_bytes(word.to_bytes(2, "big"), byte_order) for word in words]


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """One read: function code, first address, number of registers, and what is wanted of it."""

    function: int
    address: int
    count: int
    registers: tuple[RegisterConfig, ...]


def plan_requests(registers: Iterable[RegisterConfig]) -> tuple[ReadRequest, ...]:
    """As few requests as possible, in the order of function and address.

    Contiguous registers are read together, up to 125 at once; no value is split, and nothing that
    nobody asked for is read: a device may refuse a whole request for a register that it lacks.
    """
    requests: list[ReadRequest] = []
    for register in sorted(registers, key=lambda each: (FUNCTION_OF[each.table], each.address)):
        function, end = FUNCTION_OF[register.table], register.address + register.words
        last = requests[-1] if requests else None
        if last and last.function == function and register.address <= last.address + last.count:
            count = max(last.count, end - last.address)
            if count <= MOST_REGISTERS:
                requests[-1] = ReadRequest(
                    function, last.address, count, (*last.registers, register)
                )
                continue
        requests.append(ReadRequest(function, register.address, register.words, (register,)))
    return tuple(requests)
