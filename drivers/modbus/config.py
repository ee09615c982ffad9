"""User configuration of a Modbus device: network address and register map."""

from itertools import pairwise
from typing import Literal

from pydantic import Field, model_validator

from ..base import DriverConfig
from ..signals import JOINT_CHANNELS, SignalConfig, check_channels

Order = Literal["big", "little"]
Table = Literal["holding", "input"]
FUNCTION_OF: dict[Table, int] = {"holding": 3, "input": 4}
NumberType = Literal["int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
WORDS_OF: dict[NumberType, int] = {
    "int16": 1,
    "uint16": 1,
    "int32": 2,
    "uint32": 2,
    "int64": 4,
    "uint64": 4,
    "float32": 2,
    "float64": 4,
}
REGISTERS = 65_536
MOST_REGISTERS = 125
"""Of one request (Modbus application protocol 1.1b3, 6.3)."""


class RegisterConfig(SignalConfig):
    """One value of the map. It becomes a channel, or it guards the others of its group.

    Attributes:
        address: of its first register, counted from 0.
        table: holding registers (function 3) or input registers (function 4).
        type: of the number.
        group: poll group; the first one unless given.
        word_order, byte_order: the device's unless given.
        equals: no channel but a constant: where it reads otherwise, map or word order is wrong.
        heartbeat: no channel but a counter: while it rests, the device repeats old values.
    """

    address: int = Field(ge=0, lt=REGISTERS)
    table: Table = "holding"
    type: NumberType = "float32"
    group: str | None = None
    word_order: Order | None = None
    byte_order: Order | None = None
    equals: float | None = None
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
        """Registers that it takes."""
        return WORDS_OF[self.type]


class ModbusConfig(DriverConfig):
    """Settings of the Modbus driver.

    Attributes:
        host, port: of the device or gateway.
        device_id: the unit behind it.
        timeout_s: for a connection and for each reply.
        lost_after_s: without a valid reply for this long the device is lost.
        stale_after_s: a heartbeat that rests for this long makes its group's values bad.
        word_order, byte_order: of numbers longer than a register, and within a register.
        max_gap: unused registers that may be read along to save a request.
        frame_s: rows of so much time are published together.
        poll_groups: name -> period, s. The fastest makes the rows; a slower one's values come
            with the next row, and are missing in the others.
        registers: the map.
    """

    host: str = "127.0.0.1"
    port: int = Field(ge=1, le=65_535)
    device_id: int = Field(1, ge=0, le=255)
    timeout_s: float = Field(0.5, gt=0.0, le=30.0)
    lost_after_s: float = Field(1.5, gt=0.0, le=60.0)
    stale_after_s: float = Field(1.0, gt=0.0, le=3600.0)
    word_order: Order = "big"
    byte_order: Order = "big"
    max_gap: int = Field(0, ge=0, lt=MOST_REGISTERS)
    frame_s: float = Field(0.1, ge=0.001, le=1.0)
    poll_groups: dict[str, float] = Field(min_length=1)
    registers: tuple[RegisterConfig, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _check_map(self) -> "ModbusConfig":
        for name, period_s in self.poll_groups.items():
            if not 1e-4 <= period_s <= 3600.0:
                raise ValueError(f"poll_groups.{name}: {period_s:g} s, expected 0.0001 to 3600")
        for number, register in enumerate(self.registers):
            if register.group is not None and register.group not in self.poll_groups:
                known = ", ".join(self.poll_groups)
                raise ValueError(
                    f"registers[{number}].group: {register.group!r} is not one of {known}"
                )
        self._check_channels()
        return self

    def _check_channels(self) -> None:
        check_channels("registers", self.registers)
        self._check_overlaps()
        for number, register in enumerate(self.registers):
            joint = register.channel in JOINT_CHANNELS
            if joint and self.group_of(register) != self.fastest_group:
                raise ValueError(
                    f"registers[{number}].group: {register.channel} makes the rows and must be in "
                    f"the fastest group, {self.fastest_group!r}"
                )

    def _check_overlaps(self) -> None:
        """Two channels in part of the same registers: one of them reads nonsense."""
        read = [(n, each) for n, each in enumerate(self.registers) if each.channel is not None]
        read.sort(key=lambda pair: (pair[1].table, pair[1].address))
        for (first, low), (second, high) in pairwise(read):
            if low.table == high.table and high.address < low.address + low.words:
                raise ValueError(
                    f"registers[{second}].address: {high.address} is inside registers[{first}], "
                    f"whose {low.type} takes {low.words} from {low.address}"
                )

    @property
    def fastest_group(self) -> str:
        """The group that makes the rows."""
        return min(self.poll_groups, key=lambda name: self.poll_groups[name])

    def group_of(self, register: RegisterConfig) -> str:
        """The poll group of a register."""
        return register.group or next(iter(self.poll_groups))

    def key_of(self, register: RegisterConfig) -> str:
        """Key of a register in the configuration."""
        return f"registers[{self.registers.index(register)}]"
