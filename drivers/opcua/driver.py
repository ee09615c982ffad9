"""OPC UA: one subscription to an axis' variables, rows of samples out."""

import math
import time
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import ClassVar

from asyncua import ua

from edge_service.messages.samples import Quality, SampleFrame

from ..base import (
    DriverConfig,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    Probe,
)
from ..rows import QualityCounts, Values, frame_of
from ..signals import Scaling, Sentinels, scalings
from .session import LOST_AFTER_S, OpcuaSession
from .variables import NodeConfig, OpcuaConfig

MERGE_SHARE = 0.5
"""Changes closer together than this share of the sampling interval were sampled together."""
_SEVERITY = 0xC000_0000
_UNCERTAIN = 0x4000_0000
_OVERFLOW = 0x480
"""Info type "data value" with its overflow bit (OPC UA part 4, 7.39.1)."""
WILDEST_TIME_S = 1e11
"""No UNIX time in the next three thousand years is as large."""


@dataclass(frozen=True, slots=True)
class Change:
    """One notification."""

    channel: str | None  # of the variable; None for a heartbeat
    value: object  # as it was sent
    status: int  # OPC UA status code
    # source_s, server_s: UNIX times that the server gave, s; None where it gave none
    source_s: float | None
    server_s: float | None
    kind: str = "double"  # type of the value


class RowMaker:
    """Puts changes that belong together into rows.

    A variable of which nothing is heard has not changed: that is what a subscription means, as long
    as it is alive. So a row holds the last values of all variables, at the source's time of those
    that changed. Changes within half a sampling interval are one row. A heartbeat that rests for
    `stale_after_s` makes a row bad.
    """

    def __init__(
        self, scalings: dict[str, Scaling], merge_s: float, stale_after_s: float = math.inf
    ) -> None:
        self._scalings = scalings
        self._merge_s = merge_s
        self._held = dict.fromkeys(scalings, (math.nan, Quality.NO_VALUE))
        self._sentinels = Sentinels()
        self._stale_after_s = stale_after_s
        self._beat_s: float | None = None
        self._newest_s = -math.inf
        self._heard_s = -math.inf

    def rows(self, changes: Sequence[Change], now_s: float) -> list[tuple[float, Values]]:
        """Rows of one publication, in the order of their times.

        What has no time of its own gets that of the arrival, a UNIX time.
        """
        timed = [(each.source_s or each.server_s or now_s, each) for each in changes]
        rows: list[tuple[float, Values]] = []
        start_s, heard = -math.inf, set[str | None]()
        for time_s, change in sorted(timed, key=lambda each: each[0]):
            if time_s - start_s > self._merge_s or change.channel in heard:
                start_s, heard = time_s, set()
                rows.append((time_s, {}))
            heard.add(change.channel)
            if change.channel is None:
                self._beat_s = time_s
            else:
                self._held[change.channel] = self._sample(change, change.channel)
            rows[-1] = (start_s, self._row(start_s))
        if rows:
            self._newest_s, self._heard_s = rows[-1][0], now_s
        return rows

    def unchanged(self, now_s: float, back_s: float) -> list[tuple[float, Values]]:
        """The row that a sign of life without changes stands for: all is as it was.

        Its time is `back_s` before what the source's clock must show now, so that what follows is
        not earlier.
        """
        time_s = self._newest_s + (now_s - self._heard_s) - back_s
        if not math.isfinite(time_s) or time_s <= self._newest_s:
            return []
        self._newest_s, self._heard_s = time_s, now_s - back_s
        return [(time_s, self._row(time_s))]

    def _row(self, time_s: float) -> Values:
        """Held values, or all marked stale; a heartbeat counts from the first row on."""
        if self._beat_s is None:
            self._beat_s = time_s
        if time_s - self._beat_s > self._stale_after_s:
            return dict.fromkeys(self._held, (math.nan, Quality.STALE))
        return dict(self._held)

    def _sample(self, change: Change, channel: str) -> tuple[float, Quality]:
        severity = change.status & _SEVERITY
        if severity not in (0, _UNCERTAIN):
            return math.nan, Quality.SOURCE_BAD
        if isinstance(change.value, bool) or not isinstance(change.value, int | float):
            return math.nan, Quality.NOT_A_NUMBER
        raw = float(change.value)
        if "int" in change.kind and self._sentinels.has(channel, raw, change.kind):
            return math.nan, Quality.NO_VALUE
        value, quality = self._scalings[channel].si(raw)
        if quality is Quality.GOOD:
            if severity == _UNCERTAIN:
                quality = Quality.SOURCE_UNCERTAIN
            elif change.status & _OVERFLOW == _OVERFLOW:
                quality = Quality.OVERFLOW
            elif change.source_s is None:
                quality = Quality.NO_SOURCE_TIME
        return value, quality


class OpcuaDriver:
    """One axis on one server, over a session of its own.

    Values come as the server publishes them, with the source's own times and its judgement of
    them. A server that says nothing for 2 s, or three publications, is lost.
    """

    config_model: ClassVar[type[DriverConfig]] = OpcuaConfig
    paced = True

    def __init__(self, config: OpcuaConfig, context: DriverContext) -> None:
        self._config = config
        self._scalings = scalings(config.signals, context.machine, "signals")
        self._channels = tuple(self._scalings)
        self._counts = {"publications": 0, "changes": 0, "dropped_publications": 0, "sessions": 0}
        self._qualities = QualityCounts()
        self._session: OpcuaSession | None = None
        self._maker: RowMaker | None = None

    @property
    def counters(self) -> dict[str, int]:
        return self._counts | self._qualities.counts

    @property
    def readings(self) -> dict[str, float]:
        """Intervals that the server has granted, s."""
        session = self._session
        if session is None:
            return {}
        return {"publishing_s": session.publishing_s, "sampling_s": session.sampling_s}

    async def open(self) -> None:
        if self._session is not None and self._session.connected:
            return
        await self.close()
        session = OpcuaSession(self._config, self._counts)
        try:
            await session.open()
        except DriverMisconfiguredError as error:
            if self._counts["sessions"]:  # it has worked: the server is on its way up or down
                raise DriverUnavailableError(str(error)) from None
            raise
        self._session = session
        self._counts["sessions"] += 1
        merge_s = MERGE_SHARE * max(session.sampling_s, 1e-3)
        self._maker = RowMaker(self._scalings, merge_s, self._config.stale_after_s)

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """A frame per publication until `close`, or DriverUnavailableError."""
        session, maker = self._session, self._maker
        if session is None or maker is None or not session.connected:
            raise DriverUnavailableError(f"{self._config.url}: the session is not open")
        patience_s = max(LOST_AFTER_S, 3.0 * session.publishing_s)
        while True:
            result = await session.next(patience_s)
            if result is None or self._session is not session:
                return
            now_s, changes = time.time(), self._changes(result)
            self._counts["publications"] += 1
            self._counts["changes"] += len(changes)
            if changes:
                rows = maker.rows(changes, now_s)
            else:
                rows = maker.unchanged(now_s, session.publishing_s)
            if rows:
                yield self._qualities.count(frame_of(rows, self._channels))

    async def probe(self) -> Probe:
        """Channels and rate, once all variables have been found. Raises like `open`."""
        session = OpcuaSession(self._config, dict(self._counts))
        try:
            await session.open()
        finally:
            await session.close()
        words = f"OPC UA server {self._config.url}, publishing every {session.publishing_s:g} s"
        rate_hz = 1.0 / session.sampling_s if session.sampling_s > 0.0 else None
        return Probe(words, self._channels, rate_hz)

    async def close(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            await session.close()

    def _changes(self, result: ua.PublishResult) -> list[Change]:
        changes: list[Change] = []
        for data in result.NotificationMessage.NotificationData or ():
            if isinstance(data, ua.DataChangeNotification):
                signals = self._config.signals
                changes += [
                    _change(signals[item.ClientHandle], item.Value) for item in data.MonitoredItems
                ]
            elif isinstance(data, ua.StatusChangeNotification) and not data.Status.is_good():
                ended = f"the subscription ended, {data.Status.name}"
                raise DriverUnavailableError(f"{self._config.url}: {ended}")
        return changes


def _change(signal: NodeConfig, told: ua.DataValue) -> Change:
    """The change of a variable, or of the one element of an array that is asked for."""
    variant = told.Value or ua.Variant()
    value, index = variant.Value, signal.index
    if index is not None:
        value = value[index] if isinstance(value, list) and index < len(value) else None
    return Change(
        signal.channel,
        value,
        0 if told.StatusCode is None else int(told.StatusCode.value),
        _unix_s(told.SourceTimestamp),
        _unix_s(told.ServerTimestamp),
        variant.VariantType.name.lower(),
    )


def _unix_s(moment: datetime | None) -> float | None:
    """UNIX time of a moment; None for none, and for one that cannot be."""
    if moment is None:
        return None
    time_s = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return time_s if 0.0 < time_s < WILDEST_TIME_S else None
