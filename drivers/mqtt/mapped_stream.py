"""Any JSON by a map: members of a message as the channels of an axis."""

import math
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import numpy as np

from edge_service.messages.channels import CHANNELS
from edge_service.messages.quality import Quality
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.machine import Machine

from ..rows import RowBlock, Values
from ..signals import Scaling
from .config import MqttSourceConfig
from .members import number, values_at
from .order import Order
from .payload import MessageError

_FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
MOST_ROWS = 100_000
"""Of one message."""


class MappedStream:
    """Frames out of messages by the members that the configuration names.

    Raises:
        DriverMisconfiguredError: a unit that does not measure what its channel means.
    """

    def __init__(
        self, config: MqttSourceConfig, machine: Machine, clock: Callable[[], float] = time.time
    ) -> None:
        self._config, self._clock = config, clock
        self._scalings = {
            signal.channel: Scaling.of(signal, machine, f"signals[{at}]")
            for at, signal in enumerate(config.signals)
        }
        self._members = {signal.channel: signal.member for signal in config.signals}
        self.channels = tuple(name for name in CHANNELS if name in self._scalings)
        self._order = Order()
        self.readings: dict[str, float] = {}

    @property
    def counters(self) -> dict[str, int]:
        """Samples that came again or late, and how often the source's clock was set back."""
        order = self._order
        return {
            "repeated_samples": order.repeated,
            "late_samples": order.late,
            "restarts": order.restarts,
        }

    def frames(self, message: dict[str, Any]) -> list[SampleFrame]:
        """Frames of a message. Raises MessageError."""
        found = {name: values_at(message, place) for name, place in self._members.items()}
        if not any(found.values()):
            raise MessageError("none of the members that signals name")
        rows = max(len(values) for values in found.values())
        if rows > MOST_ROWS:
            raise MessageError(f"more than {MOST_ROWS} samples")
        for name, values in found.items():
            if len(values) not in (0, 1, rows):
                raise MessageError(f"{len(values)} values of {name} beside {rows} of others")
        raw = np.full((rows, len(self.channels)), np.nan)
        for at, name in enumerate(self.channels):
            raw[: len(found[name]), at] = [number(value) for value in found[name]]
        times_s = self._times_s(message, rows)
        kept = self._order.keep(times_s, raw)
        block = RowBlock(self.channels)
        for row in np.flatnonzero(kept):
            block.add(float(times_s[row]), self._values(int(row), raw, found))
        return [block.take()] if len(block) else []

    def _values(self, row: int, raw: Floats, found: dict[str, list[Any]]) -> Values:
        """Cells of a row; a slower signal stands in the first row only."""
        values = {}
        for at, name in enumerate(self.channels):
            if not found[name] and row == 0:
                values[name] = (math.nan, Quality.NO_VALUE)
            elif row < len(found[name]):
                value, code = self._scalings[name].si(float(raw[row, at]))
                doubted = code is Quality.GOOD and self._config.time is None
                values[name] = (value, Quality.NO_SOURCE_TIME if doubted else code)
        return values

    def _times_s(self, message: dict[str, Any], rows: int) -> Floats:
        """Times of the samples, (n,). Raises MessageError where they cannot be told."""
        config = self._config
        told = [self._clock()]
        if config.time is not None:
            told = [self._seconds(value) for value in values_at(message, config.time)]
        if len(told) == 1 and rows > 1 and config.period_s is not None:
            first_s = told[0] - (rows - 1) * config.period_s if config.time is None else told[0]
            told = [first_s + row * config.period_s for row in range(rows)]
        times_s = np.array(told)
        if len(times_s) != rows:
            raise MessageError(f"{len(times_s)} times for {rows} samples; is period_s missing?")
        if not np.isfinite(times_s).all():
            raise MessageError(f"a time that is no number of {config.time_unit}")
        return times_s

    def _seconds(self, value: Any) -> float:
        unit = self._config.time_unit
        if unit != "iso":
            return number(value) * _FACTORS[unit]
        try:
            moment = datetime.fromisoformat(value)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
        except (TypeError, ValueError, OverflowError):
            return math.nan
