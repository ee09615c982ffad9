"""OPC UA: one subscription to an axis' variables, rows of samples out."""

import asyncio
import logging
import math
import time
from collections.abc import AsyncGenerator
from datetime import UTC, datetime
from typing import Any, ClassVar

from asyncua import ua

from edge_service.cancellation import heed_cancellation
from edge_service.messages.channels import CHANNELS
from edge_service.messages.samples import SampleFrame

from ..base import (
    DriverConfig,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    Probe,
)
from ..rows import QualityCounts, RowBlock, Values
from ..signals import Scaling
from .config import OpcuaConfig
from .granted import Granted
from .notifications import Change, RowMaker
from .session import OpcuaSession

log = logging.getLogger(__name__)
MERGE_SHARE = 0.5
"""Changes closer together than this share of the sampling interval were sampled together."""
MOST_WAITING = 1000
"""Publications that may wait for a reader that is too slow; the oldest is dropped."""


class OpcuaDriver:
    """One axis on one server, over a session of its own.

    Values come as the server publishes them, with the source's own times and its judgement of
    them. A server that says nothing for `lost_after_s`, not even that it is alive, is lost.
    """

    config_model: ClassVar[type[DriverConfig]] = OpcuaConfig
    paced = True

    def __init__(self, config: OpcuaConfig, context: DriverContext) -> None:
        self._config = config
        self._scalings = {
            signal.channel: Scaling.of(signal, context.machine, f"signals[{number}]")
            for number, signal in enumerate(config.signals)
            if signal.channel is not None
        }
        self._channels = tuple(name for name in CHANNELS if name in self._scalings)
        self._session = OpcuaSession(config)
        self._granted: Granted | None = None
        self._maker: RowMaker | None = None
        self._waiting: asyncio.Queue[ua.PublishResult | None] = asyncio.Queue(MOST_WAITING)
        self._qualities = QualityCounts()
        self._counts = {"publications": 0, "changes": 0, "dropped_publications": 0, "sessions": 0}

    @property
    def counters(self) -> dict[str, int]:
        """Publications, changes, sessions, and samples that were not good, by reason."""
        return self._counts | self._qualities.counts

    @property
    def readings(self) -> dict[str, float]:
        """Parameters that the server granted on request: intervals, queue, limits."""
        return {} if self._granted is None else self._granted.as_readings()

    async def open(self) -> None:
        """Connect and subscribe. Raises DriverUnavailableError or DriverMisconfiguredError."""
        if self._session.connected:
            return
        await self._session.close()
        self._session, self._waiting = OpcuaSession(self._config), asyncio.Queue(MOST_WAITING)
        session, waiting = self._session, self._waiting
        try:
            await session.connect()
            limits = await session.limits()
            nodes = await session.find(self._config.signals)
            self._granted = await session.subscribe(
                nodes, limits, lambda result: self._receive(waiting, result)
            )
        except DriverMisconfiguredError as error:
            await session.close()
            if self._counts["sessions"]:  # it has worked: the server is on its way up or down
                raise DriverUnavailableError(str(error)) from None
            raise
        except BaseException:
            await session.close()
            raise
        heed_cancellation()
        self._counts["sessions"] += 1
        self._maker = self._make_maker(self._granted)
        self._tell_what_was_granted(self._granted)

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """A frame per publication until `close`, or DriverUnavailableError."""
        session, waiting = self._session, self._waiting
        granted, maker = self._granted, self._maker
        if not session.connected or granted is None or maker is None:
            raise DriverUnavailableError(f"{self._config.url}: the session is not open")
        block = RowBlock(self._channels)
        patience_s = max(self._config.lost_after_s, 3.0 * granted.publishing_s)
        while True:
            result = await self._next(session, waiting, patience_s)
            if result is None or self._session is not session:
                return
            for time_s, values in self._rows(maker, result, granted):
                self._qualities.count(values)
                block.add(time_s, values)
            if len(block):
                yield block.take()

    async def probe(self) -> Probe:
        """Channels and rate, once all variables have been found. Raises like `open`."""
        session = OpcuaSession(self._config)
        try:
            await session.connect()
            limits = await session.limits()
            granted = await session.subscribe(
                await session.find(self._config.signals), limits, lambda _: None
            )
        finally:
            await session.close()
        rate_hz = 1.0 / granted.sampling_s if granted.sampling_s > 0.0 else None
        return Probe(
            f"OPC UA server {self._config.url}, publishing every {granted.publishing_s:g} s",
            self._channels,
            rate_hz,
        )

    async def close(self) -> None:
        """End `frames` and leave; safe twice."""
        session, waiting = self._session, self._waiting
        self._session = OpcuaSession(self._config)
        _push(waiting, None)
        await session.close()

    def _make_maker(self, granted: Granted) -> RowMaker:
        config = self._config
        merge_s = MERGE_SHARE * max(granted.sampling_s, 1e-3)
        stale_after_s = config.stale_after_s if config.has_heartbeat else math.inf
        return RowMaker(self._scalings, merge_s, stale_after_s)

    async def _next(
        self,
        session: OpcuaSession,
        waiting: "asyncio.Queue[ua.PublishResult | None]",
        patience_s: float,
    ) -> ua.PublishResult | None:
        """The next publication; None after `close`."""
        url = self._config.url
        getting = asyncio.ensure_future(waiting.get())
        losing = asyncio.ensure_future(session.lost.wait())
        try:
            await asyncio.wait(
                {getting, losing}, timeout=patience_s, return_when=asyncio.FIRST_COMPLETED
            )
            if getting.done():
                return getting.result()
            if self._session is not session:
                return None
            problem = "connection closed" if losing.done() else f"no message for {patience_s:g} s"
            await session.close()
            heed_cancellation()
            raise DriverUnavailableError(f"{url}: {problem}")
        finally:
            getting.cancel()
            losing.cancel()

    def _receive(
        self, waiting: "asyncio.Queue[ua.PublishResult | None]", result: ua.PublishResult
    ) -> None:
        self._counts["publications"] += 1
        if not _push(waiting, result):
            self._counts["dropped_publications"] += 1

    def _rows(
        self, maker: RowMaker, result: ua.PublishResult, granted: Granted
    ) -> list[tuple[float, Values]]:
        now_s = time.time()
        changes: list[Change] = []
        for data in result.NotificationMessage.NotificationData or ():
            if isinstance(data, ua.DataChangeNotification):
                changes += [self._change(item) for item in data.MonitoredItems]
            elif isinstance(data, ua.StatusChangeNotification) and not data.Status.is_good():
                raise DriverUnavailableError(
                    f"{self._config.url}: the subscription ended, {data.Status.name}"
                )
        self._counts["changes"] += len(changes)
        if changes:
            return maker.rows(changes, now_s)
        return maker.unchanged(now_s, granted.publishing_s)

    def _change(self, item: Any) -> Change:
        data = item.Value
        return Change(
            channel=self._config.signals[item.ClientHandle].channel,
            value=data.Value.Value if data.Value is not None else None,
            status=0 if data.StatusCode is None else int(data.StatusCode.value),
            source_s=_unix_s(data.SourceTimestamp),
            server_s=_unix_s(data.ServerTimestamp),
        )

    def _tell_what_was_granted(self, granted: Granted) -> None:
        asked = self._config
        if granted.sampling_s > asked.sampling_s or granted.publishing_s > asked.publishing_s:
            log.info(
                "%s: asked for %g s sampling and %g s publishing, got %g s and %g s",
                asked.url,
                asked.sampling_s,
                asked.publishing_s,
                granted.sampling_s,
                granted.publishing_s,
            )


def _push(waiting: "asyncio.Queue[ua.PublishResult | None]", result: Any) -> bool:
    """Put in, dropping the oldest where there is no room; whether there was."""
    room = not waiting.full()
    if not room:
        waiting.get_nowait()
    waiting.put_nowait(result)
    return room


def _unix_s(moment: datetime | None) -> float | None:
    if moment is None:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
