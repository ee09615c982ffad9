"""Modbus TCP: registers polled in groups, rows of samples out."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import ClassVar

from edge_service.messages.channels import CHANNELS
from edge_service.messages.quality import Quality
from edge_service.messages.samples import SampleFrame

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..rows import QualityCounts, RowBlock, Values
from .config import ModbusConfig
from .link import ModbusLink, Reply
from .polling import PollGroup
from .reading import RegisterReader
from .requests import ReadRequest

ANSWERED = (Quality.GOOD, Quality.DEVICE_EXCEPTION)
"""Qualities of a reply from a device that is present."""
LATE_SHARE = 0.5
"""A read that takes longer than this share of its period says too little of when it was."""


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
        self._link = ModbusLink(config.host, config.port, config.device_id, config.timeout_s)
        self._channels = tuple(
            name for name in CHANNELS if name in {each.channel for each in config.registers}
        )
        self._qualities = QualityCounts()
        self._counts = {"polls": 0, "failed_polls": 0, "missed_polls": 0, "connections": 0}
        self._problem = ""
        self._valid_s: float | None = None
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
            await self._hear()
        except BaseException:
            self._link.close()
            raise

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of about `frame_s` until `close`, or DriverUnavailableError."""
        epoch, loop = self._epoch, asyncio.get_running_loop()
        if not self._link.connected:
            raise DriverUnavailableError(f"{self._address}: the device is not open")
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
            if block.span_s + groups[0].period_s >= self._config.frame_s:
                yield block.take()
            self._check_alive(loop.time())

    async def probe(self) -> Probe:
        """Channels and rate, once the device has answered every request. Raises like `open`."""
        link = ModbusLink(*self._endpoint, self._config.timeout_s)
        try:
            await link.connect()
            for group in PollGroup.all_of(self._config, 0.0):
                for request in group.requests:
                    await self._try(link, request)
        finally:
            link.close()
        fastest_s = self._config.poll_groups[self._config.fastest_group]
        return Probe(f"Modbus device {self._address}", self._channels, 1.0 / fastest_s)

    async def close(self) -> None:
        """End `frames` and let go of the connection; safe twice."""
        self._epoch += 1
        self._link.close()

    @property
    def _address(self) -> str:
        return f"{self._config.host}:{self._config.port} unit {self._config.device_id}"

    @property
    def _endpoint(self) -> tuple[str, int, int]:
        return self._config.host, self._config.port, self._config.device_id

    async def _hear(self) -> None:
        """One read of the fastest group: a device that only takes connections is not there."""
        request = PollGroup.all_of(self._config, 0.0)[0].requests[0]
        reply = await self._link.read(request)
        if reply.quality not in ANSWERED:
            raise DriverUnavailableError(f"{self._address}: {reply.problem}")

    async def _try(self, link: ModbusLink, request: ReadRequest) -> None:
        reply = await link.read(request)
        if reply.quality is not Quality.GOOD:
            key = self._config.key_of(request.registers[0])
            last = request.address + request.count - 1
            raise DriverUnavailableError(
                f"{self._address}: {key}: registers {request.address} to {last}: {reply.problem}"
            )

    async def _poll(self, groups: list[PollGroup], now_s: float) -> tuple[float, Values]:
        """Time and values of one row: the fastest group, and the slower ones that are due."""
        fastest, *slower = groups
        self._counts["missed_polls"] += fastest.step(now_s)
        exchanges = await self._exchange(fastest.requests)
        first, last = exchanges[0][1], exchanges[-1][1]
        self._span_s = last.received_s - first.sent_s
        values = self._reader.values(exchanges)
        if self._span_s > LATE_SHARE * fastest.period_s:
            values = _doubted(values)
        for group in slower:
            if group.due_s <= now_s:
                group.step(now_s)
                values = {**values, **self._reader.values(await self._exchange(group.requests))}
        self._qualities.count(values)
        return 0.5 * (first.sent_s + last.received_s), values

    async def _exchange(self, requests: tuple[ReadRequest, ...]) -> list[tuple[ReadRequest, Reply]]:
        """Ask for a whole group; after a failure the rest fails for the same reason, unasked."""
        exchanges: list[tuple[ReadRequest, Reply]] = []
        failed: Reply | None = None
        for request in requests:
            if failed is None and not self._link.connected:
                await self._connect_again()
            reply = failed or await self._link.read(request)
            self._note(reply)
            failed = None if reply.quality in ANSWERED else reply
            exchanges.append((request, reply))
        return exchanges

    async def _connect_again(self) -> None:
        epoch = self._epoch
        await self._link.connect()
        if self._epoch != epoch:  # closed meanwhile
            self._link.close()
            return
        self._counts["connections"] += 1
        self._reader.forget()

    def _note(self, reply: Reply) -> None:
        self._counts["polls"] += 1
        if reply.quality in ANSWERED:
            self._valid_s = reply.received_s
        if reply.quality is not Quality.GOOD:
            self._counts["failed_polls"] += 1
            self._problem = reply.problem

    def _check_alive(self, now_s: float) -> None:
        """Raise DriverUnavailableError where nothing valid has been heard for too long."""
        if self._valid_s is not None and now_s - self._valid_s > self._config.lost_after_s:
            self._link.close()
            raise DriverUnavailableError(
                f"{self._address}: no valid reply for {now_s - self._valid_s:.1f} s "
                f"({self._problem})"
            )


def _doubted(values: Values) -> Values:
    return {
        channel: (value, Quality.LATE_READ if code is Quality.GOOD else code)
        for channel, (value, code) in values.items()
    }
