"""JSON of any maker as rows of samples, by the members that the configuration names."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import numpy as np

from edge_service.messages.edge_block import LONGEST_S
from edge_service.messages.samples import SI, Floats, Quality, SampleFrame
from edge_service.models.machine import Machine

from ..rows import Values, frame_of
from ..signals import scalings
from .link import MqttSourceConfig
from .streams import MessageError, Order

MOST_ROWS = 100_000  # of one message


class MappedStream:
    """Frames out of messages by the members that the configuration names.

    Raises DriverMisconfiguredError: a unit that does not measure what its channel means.
    """

    def __init__(
        self, config: MqttSourceConfig, machine: Machine, clock: Callable[[], float] = time.time
    ) -> None:
        self._config, self._clock = config, clock
        self._scalings = scalings(config.signals, machine, "signals")
        self._members = {signal.channel: signal.member for signal in config.signals}
        self.channels = tuple(self._scalings)
        self._order = Order(are_times=True)
        self.counters = self._order.counts
        self.readings: dict[str, float] = {}

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
        taken = np.flatnonzero(self._order.keep(times_s, raw)).tolist()
        kept_rows = [(float(times_s[row]), self._values(row, raw, found)) for row in taken]
        return [frame_of(kept_rows, self.channels)] if kept_rows else []

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
        if not (np.abs(times_s) <= LONGEST_S).all():
            raise MessageError(f"a time that no clock shows in {config.time_unit}: right unit?")
        return times_s

    def _seconds(self, value: Any) -> float:
        unit = self._config.time_unit
        if unit != "iso":
            return number(value) * float(SI[unit][0])
        try:
            moment = datetime.fromisoformat(value)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
        except (TypeError, ValueError, OverflowError):
            return math.nan


def values_at(document: Any, member: str) -> list[Any]:
    """Values at a place: the elements of a list, or the only one; none where nothing is there.

    Between dots stands the name of a member; `*` is every element of a list, and `name=text` are
    those elements whose member `name` is that text or number.
    """
    found = [document]
    for part in member.split("."):
        found = [value for each in found for value in _step(each, part)]
    if len(found) == 1 and isinstance(found[0], list):
        return found[0]
    return found


def number(value: Any) -> float:
    """A value as a number; NaN for what is none."""
    if not isinstance(value, bool):
        with suppress(ValueError, TypeError, OverflowError):
            return float(value)
    return math.nan


def _step(document: Any, part: str) -> list[Any]:
    if isinstance(document, dict):
        return [document[part]] if part in document else []
    if not isinstance(document, list):
        return []
    name, equals, text = part.partition("=")
    if equals:
        return [e for e in document if isinstance(e, dict) and str(e.get(name)) == text]
    if part != "*":
        raise MessageError(f"a list where {part!r} is expected")
    return document
