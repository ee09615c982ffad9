"""Modbus TCP: registers polled in groups, rows of samples out."""

import asyncio
import math
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from edge_service.messages.samples import CHANNELS, Quality, SampleFrame
from edge_service.models.machine import Machine

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..rows import FRAME_S, QualityCounts, RowBlock, Values
from ..signals import Scaling
from .link import ModbusLink, Reply
from .registers import ModbusConfig, ReadRequest, RegisterConfig, decode_number, plan_requests

ANSWERED = (Quality.GOOD, Quality.DEVICE_EXCEPTION)
"""Qualities of a reply from a device that is present."""
LATE_SHARE = 0.5
"""A read that takes longer than this share of its period says too little of when it was."""
CONSTANT_TOLERANCE = 1e-6
"""Relative difference by which a constant may be off: float32 has seven digits."""


@dataclass(slots=True)
class PollGroup:
    """A group on a fixed grid of time, so that nothing drifts.

    Attributes:
        period_s: between two polls, s.
        requests: what one poll asks for.
        due_s: when the next poll is due, on the event loop's clock.
    """

    period_s: float
    requests: tuple[ReadRequest, ...]
    due_s: float

    @classmethod
    def all_of(cls, config: ModbusConfig, now_s: float) -> "list[PollGroup]":
        """Every group that has registers, the fastest first."""
        groups = [
            cls(period_s, requests, now_s)
            for name, period_s in config.poll_groups.items()
            if (requests := plan_requests(config.of_group(name)))
        ]
        return sorted(groups, key=lambda group: group.period_s)

    def step(self, now_s: float) -> int:
        """On to the next poll; returns how many were missed and are let go."""
        missed = max(math.floor((now_s - self.due_s) / self.period_s), 0)
        self.due_s += (1 + missed) * self.period_s
        return missed


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
                first = register.address - request.address
                number = decode_number(
                    reply.words[first : first + register.words],
                    register.type,
                    register.word_order or self._config.word_order,
                    self._config.byte_order,
                )
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

    def _guard(self, register: RegisterConfig, number: float, now_s: float) -> Quality:
        """Quality that a constant or a heartbeat implies for the values beside it."""
        if register.equals is not None:
            right = math.isclose(number, register.equals, rel_tol=CONSTANT_TOLERANCE)
            return Quality.GOOD if right else Quality.WRONG_CONSTANT
        known, since_s = self._beats.get(register.address, (math.nan, now_s))
        if number != known:
            self._beats[register.address] = (number, now_s)
            return Quality.GOOD
        rests = now_s - since_s > self._config.stale_after_s(register)
        return Quality.STALE if rests else Quality.GOOD


class ModbusDriver:
    """One axis behind one Modbus device, over a connection of its own.

    Rows are those of the fastest group; their time is the midpoint between request and reply on
    the host's monotonic clock. A poll that fails makes a row of bad values, and the next one
    connects anew; without any valid reply for `lost_after_s` the device is lost. A device that
    answers with exceptions is there, and is asked on.
    """

    config_model: ClassVar[type[DriverConfig]] = ModbusConfig
    paced = True

    def __init__(
        self,
        config: ModbusConfig,
        context: DriverContext,
        *,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._config = config
        self._sleep = sleep
        self._reader = RegisterReader(config, context.machine)
        self._link = ModbusLink(*config.endpoint, config.timeout_s)
        self._channels = tuple(
            name for name in CHANNELS if name in {each.channel for each in config.registers}
        )
        self._qualities = QualityCounts()
        self._counts = {"polls": 0, "failed_polls": 0, "missed_polls": 0, "connections": 0}
        self._problem = ""
        self._valid_s = 0.0
        self._span_s = 0.0
        self._epoch = 0

    @property
    def counters(self) -> dict[str, int]:
        """Polls, failures, connections, and samples that were not good, by reason."""
        return self._counts | self._qualities.counts

    @property
    def readings(self) -> dict[str, float]:
        """Duration of the latest poll of the fastest group, s."""
        return {"poll_s": self._span_s} if self._span_s else {}

    async def open(self) -> None:
        """Connect and hear the device answer. Raises DriverUnavailableError."""
        if self._epoch and self._link.connected:
            return
        self._epoch += 1
        try:
            await self._link.connect()
            self._counts["connections"] += 1
            request = PollGroup.all_of(self._config, 0.0)[0].requests[0]
            reply = await self._link.read(request)
            if reply.quality not in ANSWERED:  # it only takes connections
                raise DriverUnavailableError(f"{self._config.address}: {reply.problem}")
        except BaseException:
            self._link.close()
            raise

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of about 0.1 s until `close`, or DriverUnavailableError."""
        epoch, loop = self._epoch, asyncio.get_running_loop()
        if not self._link.connected:
            raise DriverUnavailableError(f"{self._config.address}: the device is not open")
        self._valid_s = loop.time()
        self._reader.forget()
        groups = PollGroup.all_of(self._config, loop.time())
        block = RowBlock(self._channels)
        while self._epoch == epoch:
            await self._sleep(max(groups[0].due_s - loop.time(), 0.0))
            if self._epoch != epoch:
                return
            time_s, values = await self._poll(groups, loop.time())
            if self._epoch != epoch:
                return
            block.add(time_s, values)
            if block.span_s + groups[0].period_s >= FRAME_S:
                yield self._qualities.count(block.take())
            silent_s = loop.time() - self._valid_s
            if silent_s > self._config.lost_after_s:
                self._link.close()
                raise DriverUnavailableError(
                    f"{self._config.address}: no valid reply for {silent_s:.1f} s ({self._problem})"
                )

    async def probe(self) -> Probe:
        """Channels and rate, once the device has answered every request. Raises like `open`."""
        link = ModbusLink(*self._config.endpoint, self._config.timeout_s)
        try:
            await link.connect()
            for group in PollGroup.all_of(self._config, 0.0):
                for request in group.requests:
                    reply = await link.read(request)
                    if reply.quality is not Quality.GOOD:
                        key = self._config.key_of(request.registers[0])
                        last = request.address + request.count - 1
                        raise DriverUnavailableError(
                            f"{self._config.address}: {key}: registers {request.address} to "
                            f"{last}: {reply.problem}"
                        )
        finally:
            link.close()
        fastest_s = self._config.poll_groups[self._config.fastest_group]
        return Probe(f"Modbus device {self._config.address}", self._channels, 1.0 / fastest_s)

    async def close(self) -> None:
        """End `frames` and let go of the connection; safe twice."""
        self._epoch += 1
        self._link.close()

    async def _poll(self, groups: list[PollGroup], now_s: float) -> tuple[float, Values]:
        """Time and values of one row: the fastest group, and the slower ones that are due."""
        fastest, *slower = groups
        self._counts["missed_polls"] += fastest.step(now_s)
        exchanges = await self._exchange(fastest.requests)
        first, last = exchanges[0][1], exchanges[-1][1]
        self._span_s = last.received_s - first.sent_s
        values = self._reader.values(exchanges)
        if self._span_s > LATE_SHARE * fastest.period_s:
            values = {
                channel: (value, Quality.LATE_READ if code is Quality.GOOD else code)
                for channel, (value, code) in values.items()
            }
        for group in slower:
            if group.due_s <= now_s:
                group.step(now_s)
                values = {**values, **self._reader.values(await self._exchange(group.requests))}
        return 0.5 * (first.sent_s + last.received_s), values

    async def _exchange(self, requests: tuple[ReadRequest, ...]) -> list[tuple[ReadRequest, Reply]]:
        """Ask for a whole group; after a failure the rest fails for the same reason, unasked."""
        exchanges: list[tuple[ReadRequest, Reply]] = []
        failed: Reply | None = None
        for request in requests:
            if failed is None and not self._link.connected:
                epoch = self._epoch
                await self._link.connect()
                if self._epoch == epoch:
                    self._counts["connections"] += 1
                    self._reader.forget()
                else:  # closed meanwhile
                    self._link.close()
            reply = failed or await self._link.read(request)
            self._counts["polls"] += 1
            if reply.quality in ANSWERED:
                self._valid_s = reply.received_s
            if reply.quality is not Quality.GOOD:
                self._counts["failed_polls"] += 1
                self._problem = reply.problem
            failed = None if reply.quality in ANSWERED else reply
            exchanges.append((request, reply))
        return exchanges
