"""Registers of one poll group as values in SI units, each with its quality."""

import math
from collections.abc import Mapping, Sequence

from edge_service.messages.quality import Quality
from edge_service.models.machine import Machine

from ..rows import Values
from ..signals import Scaling
from .config import ModbusConfig, RegisterConfig
from .link import Reply
from .numbers import decode_number
from .requests import ReadRequest

CONSTANT_TOLERANCE = 1e-6
"""Relative difference by which a constant may be off: float32 has seven digits."""


class RegisterReader:
    """Reads values out of replies, and keeps watch over constants and heartbeats.

    Raises:
        DriverMisconfiguredError: a unit that does not measure what its channel means.
    """

    def __init__(self, config: ModbusConfig, machine: Machine) -> None:
        self._config = config
        self._scalings: Mapping[str, Scaling] = {
            register.channel: Scaling.of(register, machine, f"registers[{number}]")
            for number, register in enumerate(config.registers)
            if register.channel is not None
        }
        self._beats: dict[int, tuple[float, float]] = {}  # address -> value, since when

    def values(self, exchanges: Sequence[tuple[ReadRequest, Reply]]) -> Values:
        """Value and quality of each channel of a poll group, from its requests and replies.

        A constant that reads otherwise, or a heartbeat that rests, speaks for the whole group.
        """
        values: dict[str, tuple[float, Quality]] = {}
        spoiled = Quality.GOOD
        for request, reply in exchanges:
            for register in request.registers:
                if reply.quality is not Quality.GOOD:
                    if register.channel is not None:
                        values[register.channel] = (math.nan, reply.quality)
                    continue
                number = self._number(register, request, reply)
                if register.channel is not None:
                    values[register.channel] = self._scalings[register.channel].si(number)
                else:
                    spoiled = max(spoiled, self._guard(register, number, reply.midpoint_s))
        if spoiled is Quality.GOOD:
            return values
        return dict.fromkeys(values, (math.nan, spoiled))

    def forget(self) -> None:
        """Forget heartbeats: the device may have started anew."""
        self._beats.clear()

    def _number(self, register: RegisterConfig, request: ReadRequest, reply: Reply) -> float:
        first = register.address - request.address
        words = reply.words[first : first + register.words]
        config = self._config
        return decode_number(
            words,
            register.type,
            register.word_order or config.word_order,
            register.byte_order or config.byte_order,
        )

    def _guard(self, register: RegisterConfig, number: float, now_s: float) -> Quality:
        """Quality that a constant or a heartbeat implies for the values beside it."""
        if register.equals is not None:
            right = math.isclose(number, register.equals, rel_tol=CONSTANT_TOLERANCE)
            return Quality.GOOD if right else Quality.WRONG_CONSTANT
        known, since_s = self._beats.get(register.address, (math.nan, now_s))
        if number != known:
            self._beats[register.address] = (number, now_s)
            return Quality.GOOD
        rests = now_s - since_s > self._config.stale_after_s
        return Quality.STALE if rests else Quality.GOOD
