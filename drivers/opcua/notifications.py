"""Notifications of changed values as rows of samples. Pure: every time is in the data."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from edge_service.messages.quality import Quality

from ..rows import Values
from ..signals import Scaling

_SEVERITY = 0xC000_0000
_UNCERTAIN = 0x4000_0000
_OVERFLOW = 0x480
"""Info type "data value" with its overflow bit (OPC UA part 4, 7.39.1)."""
WILDEST_TIME_S = 1e11
"""No UNIX time in the next three thousand years is as large."""


@dataclass(frozen=True, slots=True)
class Change:
    """One notification.

    Attributes:
        channel: of the variable; None for a heartbeat.
        value: as it was sent.
        status: OPC UA status code.
        source_s, server_s: UNIX times that the server gave, s; None where it gave none.
    """

    channel: str | None
    value: object
    status: int
    source_s: float | None
    server_s: float | None


class RowMaker:
    """Puts changes that belong together into rows.

    A variable of which nothing is heard has not changed: that is what a subscription means, as long
    as it is alive. So a row holds the last values of all variables, at the source's time of those
    that changed. Changes within half a sampling interval are one row.

    Args:
        scalings: channel -> how its raw value becomes SI.
        merge_s: changes so close in time are one row.
        stale_after_s: a heartbeat that rests for so long makes a row bad; infinite without one.
    """

    def __init__(
        self, scalings: dict[str, Scaling], merge_s: float, stale_after_s: float = math.inf
    ) -> None:
        self._scalings = scalings
        self._merge_s = merge_s
        self._held = dict.fromkeys(scalings, (math.nan, Quality.NO_VALUE))
        self._stale_after_s = stale_after_s
        self._beat_s: float | None = None
        self._newest_s = -math.inf
        self._heard_s = -math.inf

    def rows(self, changes: Sequence[Change], now_s: float) -> list[tuple[float, Values]]:
        """Rows of one publication, in the order of their times.

        Args:
            changes: what it holds.
            now_s: UNIX time of its arrival, for what has no time of its own.
        """
        timed = sorted(
            ((self._time_of(change, now_s), change) for change in changes), key=lambda each: each[0]
        )
        rows: list[tuple[float, Values]] = []
        start_s, heard = -math.inf, set[str | None]()
        for time_s, change in timed:
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

    def _time_of(self, change: Change, now_s: float) -> float:
        for time_s in (change.source_s, change.server_s):
            if time_s is not None and 0.0 < time_s < WILDEST_TIME_S:
                return time_s
        return now_s

    def _sample(self, change: Change, channel: str) -> tuple[float, Quality]:
        severity = change.status & _SEVERITY
        if severity not in (0, _UNCERTAIN):
            return math.nan, Quality.SOURCE_BAD
        if isinstance(change.value, bool) or not isinstance(change.value, int | float):
            return math.nan, Quality.NOT_A_NUMBER
        value, quality = self._scalings[channel].si(float(change.value))
        return value, quality if quality is not Quality.GOOD else self._doubt(change)

    def _doubt(self, change: Change) -> Quality:
        if change.status & _SEVERITY == _UNCERTAIN:
            return Quality.SOURCE_UNCERTAIN
        if change.status & _OVERFLOW == _OVERFLOW:
            return Quality.OVERFLOW
        if change.source_s is None or not 0.0 < change.source_s < WILDEST_TIME_S:
            return Quality.NO_SOURCE_TIME
        return Quality.GOOD
