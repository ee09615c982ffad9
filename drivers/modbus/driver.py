"""Modbus TCP: registers polled in groups, rows of samples out."""

import asyncio
import math
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from edge_service.messages.samples import Quality, SampleFrame

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..rows import FRAME_S, QualityCounts, Values, frame_of
from ..signals import Sentinels, scalings
from .link import ModbusLink, Reply
from .registers import ModbusConfig, ReadRequest, RegisterConfig, decode_number, plan_requests

ANSWERED = (Quality.GOOD, Quality.DEVICE_EXCEPTION)
"""Qualities of a reply from a device that is present."""
LATE_SHARE = 0.5
"""A read that takes longer than this share of its period says too little of when it was."""
CONSTANT_TOLERANCE = 1e-6
"""Relative difference by which a constant may be off: float32 has seven digits."""
Exchange = tuple[ReadRequest, Reply]


@dataclass(slots=True)
class PollGroup:
    """A group on a fixed grid of time, so that nothing drifts."""

    period_s: float  # between two polls, s
    requests: tuple[ReadRequest, ...]  # what one poll asks for
    due_s: float  # when the next poll is due, on the event loop's clock

    def step(self, now_s: float) -> int:
        """On to the next poll; returns how many were missed and are let go."""
        missed = max(math.floor((now_s - self.due_s) / self.period_s), 0)
        self.due_s += (1 + missed) * self.period_s
        return missed


class ModbusDriver:
    """One axis behind one Modbus device, over a connection of its own.

    Rows are those of the fastest group; their time is the midpoint between request and reply on
    the host's monotonic clock. A poll that fails makes a row of bad values, and the next one
    connects anew; without any valid reply in three of them, or timeouts, the device is lost. One
    that answers with exceptions is there, and is asked on.
    """

    config_model: ClassVar[type[DriverConfig]] = ModbusConfig
    paced = True

    def __init__(self, config: ModbusConfig, context: DriverContext) -> None:
        self._config = config
        self._scalings = scalings(config.registers, context.machine, "registers")
        self._channels = tuple(self._scalings)
        self._link: ModbusLink | None = None
        self._beats: dict[int, tuple[float, float]] = {}  # address -> value, since when
        self._sentinels = Sentinels()
        self._qualities = QualityCounts()
        self._counts = {"polls": 0, "failed_polls": 0, "missed_polls": 0, "connections": 0}
        self._problem = ""
        self._valid_s = self._span_s = 0.0

    @property
    def counters(self) -> dict[str, int]:
        return self._counts | self._qualities.counts

    @property
    def readings(self) -> dict[str, float]:
        """Duration of the latest poll of the fastest group, s."""
        return {"poll_s": self._span_s} if self._span_s else {}

    async def open(self) -> None:
        """Connect and hear the device answer. Raises DriverUnavailableError."""
        if self._link is not None and self._link.connected:
            return
        await self.close()
        link = self._link = self._new_link()
        try:
            await link.connect()
            reply = await link.read(self._groups(0.0)[0].requests[0])
            if reply.quality not in ANSWERED:  # it only takes connections
                raise DriverUnavailableError(f"{self._config.address}: {reply.problem}")
        except BaseException:
            link.close()
            raise
        self._counts["connections"] += 1

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of about 0.1 s until `close`, or DriverUnavailableError."""
        link, loop = self._link, asyncio.get_running_loop()
        if link is None or not link.connected:
            raise DriverUnavailableError(f"{self._config.address}: the device is not open")
        self._valid_s = loop.time()
        self._beats.clear()
        groups = self._groups(loop.time())
        rows: list[tuple[float, Values]] = []
        try:
            while self._link is link:
                await asyncio.sleep(max(groups[0].due_s - loop.time(), 0.0))
                time_s, values = await self._poll(link, groups, loop.time())
                if self._link is not link:
                    return
                rows.append((time_s, values))
                if time_s - rows[0][0] + groups[0].period_s >= FRAME_S:
                    yield self._qualities.count(frame_of(rows, self._channels))
                    rows = []
                silent_s = loop.time() - self._valid_s
                if silent_s > 3.0 * max(self._config.timeout_s, self._config.fastest_s):
                    link.close()
                    silence = f"no valid reply for {silent_s:.1f} s ({self._problem})"
                    raise DriverUnavailableError(f"{self._config.address}: {silence}")
        finally:
            if self._link is not link:
                link.close()

    async def probe(self) -> Probe:
        """Channels and rate, once the device has answered every request. Raises like `open`."""
        config, link = self._config, self._new_link()
        try:
            await link.connect()
            for request in (each for group in self._groups(0.0) for each in group.requests):
                reply = await link.read(request)
                if reply.quality is not Quality.GOOD:
                    number = config.registers.index(request.registers[0])
                    last = request.address + request.count - 1
                    place = f"registers[{number}]: registers {request.address} to {last}"
                    raise DriverUnavailableError(f"{config.address}: {place}: {reply.problem}")
        finally:
            link.close()
        return Probe(f"Modbus device {config.address}", self._channels, 1.0 / config.fastest_s)

    async def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _new_link(self) -> ModbusLink:
        return ModbusLink(*self._config.endpoint, self._config.timeout_s)

    def _groups(self, now_s: float) -> list[PollGroup]:
        """Every group that has registers, the fastest first."""
        config = self._config
        groups = [
            PollGroup(period_s, requests, now_s)
            for name, period_s in config.poll_groups.items()
            if (
                requests := plan_requests(r for r in config.registers if config.group_of(r) == name)
            )
        ]
        return sorted(groups, key=lambda group: group.period_s)

    async def _poll(
        self, link: ModbusLink, groups: list[PollGroup], now_s: float
    ) -> tuple[float, Values]:
        """Time and values of one row: the fastest group, and the slower ones that are due."""
        fastest, *slower = groups
        self._counts["missed_polls"] += fastest.step(now_s)
        exchanges = await self._ask(link, fastest.requests)
        sent_s, received_s = exchanges[0][1].sent_s, exchanges[-1][1].received_s
        self._span_s = received_s - sent_s
        values = self._values(exchanges)
        if self._span_s > LATE_SHARE * fastest.period_s:
            values = {
                channel: (value, Quality.LATE_READ if code is Quality.GOOD else code)
                for channel, (value, code) in values.items()
            }
        for group in slower:
            if group.due_s <= now_s:
                group.step(now_s)
                values |= self._values(await self._ask(link, group.requests))
        return 0.5 * (sent_s + received_s), values

    async def _ask(self, link: ModbusLink, requests: tuple[ReadRequest, ...]) -> list[Exchange]:
        """Ask for a whole group; after a failure the rest fails for the same reason, unasked."""
        exchanges: list[Exchange] = []
        failed: Reply | None = None
        for request in requests:
            if failed is None and not link.connected and self._link is link:
                await link.connect()
                self._counts["connections"] += 1
                self._beats.clear()  # the device may have started anew
            reply = failed or await link.read(request)
            self._counts["polls"] += 1
            if reply.quality in ANSWERED:
                self._valid_s = reply.received_s
            else:
                failed = reply
            if reply.quality is not Quality.GOOD:
                self._counts["failed_polls"] += 1
                self._problem = reply.problem
            exchanges.append((request, reply))
        return exchanges

    def _values(self, exchanges: Sequence[Exchange]) -> dict[str, tuple[float, Quality]]:
        """Value and quality of each channel of a group.

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
                    if self._sentinels.has(register.channel, number, register.type):
                        values[register.channel] = (math.nan, Quality.NO_VALUE)
                    else:
                        values[register.channel] = self._scalings[register.channel].si(number)
                else:
                    spoiled = max(spoiled, self._guard(register, number, reply.received_s))
        return values if spoiled is Quality.GOOD else dict.fromkeys(values, (math.nan, spoiled))

    def _guard(self, register: RegisterConfig, number: float, now_s: float) -> Quality:
        """Quality that a constant or a heartbeat implies for the values beside it."""
        if register.equals is not None:
            right = math.isclose(number, register.equals, rel_tol=CONSTANT_TOLERANCE)
            return Quality.GOOD if right else Quality.WRONG_CONSTANT
        known, since_s = self._beats.get(register.address, (math.nan, now_s))
        if number != known:
            self._beats[register.address] = (number, now_s)
            return Quality.GOOD
        period_s = self._config.poll_groups[self._config.group_of(register)]
        return Quality.STALE if now_s - since_s > max(1.0, 3.0 * period_s) else Quality.GOOD
