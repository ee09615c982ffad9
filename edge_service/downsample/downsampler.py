"""Downsampling of screened rows to statistics of intervals on a fixed grid of time."""

import sys
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..checks.live.channel_check import ChannelCheck
from ..checks.live.channel_limits import ChannelLimits
from ..messages.features import UNUSABLE, Fault, FeatureBlock
from ..messages.row_faults import T
from ..messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame, is_uncertain
from ..messages.stored import Stored, decoded, encoded
from .rows import RowScreen, Screened, table_of
from .statistics import (
    IntervalRows,
    MotionHistory,
    PlausibilitySettings,
    absent_block,
    summarise,
)

_SNAPSHOT_SCHEMA = "downsampler/3"
_SCREEN: Stored[RowScreen | None] = Stored(RowScreen | None)
_LEARN_ROWS = 16  # rows from which the native period is learned
_DOUBTED_CHANNELS = {TORQUE, ANGLE, TABLE_POSITION}
_LEAST_SAMPLES = 5  # in an interval, for the torque held between them to be a fair picture
_MOST_DOUBTED = 1024
_OF_TABLE = (
    Fault.NO_TABLE
    | Fault.TABLE_STUCK
    | Fault.TABLE_DISAGREES
    | Fault.TABLE_DOUBTED
    | Fault.TABLE_SHIFTED
)
_GRID_SLACK = 1e-4  # share of an interval by which a time stamp may fall short of the grid


@dataclass(frozen=True, slots=True)
class DownsampleSettings:
    """Settings for the reduction of samples to intervals.

    Attributes:
        interval_s: length of an interval, s.
        max_hole_rows: so many native periods without a row are bridged; more is a gap.
        channels: limits between the encoders; those of the lead alone unless given.
    """

    interval_s: float = 0.1
    max_hole_rows: int = 6
    plausibility: PlausibilitySettings = field(default_factory=PlausibilitySettings)
    channels: ChannelLimits | None = None


@dataclass(slots=True, eq=False)
class _Segment:
    """Rows without a gap between them.

    Attributes:
        rows: (n, 8), from the reach before the current interval on.
        fault: (n,), bits of Fault found just before each row.
        first: first row of the current interval.
        seen: rows that were searched for gaps.
        history: motion before the current interval.
    """

    rows: Floats = field(default_factory=lambda: np.empty((0, 8)))
    fault: npt.NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    first: int = 0
    seen: int = 0
    history: MotionHistory = field(default_factory=MotionHistory)

    def append(self, rows: Floats, fault: npt.NDArray[np.int64]) -> None:
        """Add rows at the end."""
        self.rows = np.concatenate([self.rows, rows])
        self.fault = np.concatenate([self.fault, fault])

    def split(self, row: int) -> "_Segment":
        """Cut before `row`; return what followed."""
        rest = _Segment(self.rows[row:], self.fault[row:])
        self.rows, self.fault = self.rows[:row], self.fault[:row]
        return rest

    def forget(self, reach: int) -> None:
        """Keep only what later differences need."""
        drop = max(0, self.first - reach - 1)
        self.rows, self.fault = self.rows[drop:], self.fault[drop:]
        self.first -= drop
        self.seen = max(0, self.seen - drop)


class Downsampler:
    """Downsampler of one axis: sample frames in, feature blocks out.

    The blocks depend on the samples alone, not on how they were parted into frames.

    Args:
        settings: interval and limits.
        ratio_m_per_rad: table travel per radian of the screw.
    """

    def __init__(self, settings: DownsampleSettings, ratio_m_per_rad: float) -> None:
        self._settings = settings
        self._ratio = ratio_m_per_rad
        self._channels = ChannelCheck(
            settings.channels or ChannelLimits.of_ratio(ratio_m_per_rad),
            settings.plausibility.max_speed_rad_s,
        )
        self._screen: RowScreen | None = None
        self._segment = _Segment()
        self._period_s: float | None = None
        self._reach = 1
        self._absent: dict[int, Fault] = {}  # interval -> values that its rows lack
        self._doubted: set[int] = set()  # intervals with samples that the source doubts
        self._pending_fault = Fault.NONE  # end of a segment without an interval left to report it
        self._last_kept = -sys.maxsize  # interval of the last row that was kept
        self._expected_faults = ~Fault.NONE
        self.faults: dict[str, int] = {}

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values; `restore` of it goes on bit-equal."""
        segment = self._segment
        return {
            "schema": _SNAPSHOT_SCHEMA,
            "screen": _SCREEN.dump(self._screen),
            "rows": encoded(segment.rows),
            "fault": encoded(segment.fault),
            "first": segment.first,
            "seen": segment.seen,
            "direction": segment.history.direction,
            "moving_since_s": encoded(np.array([segment.history.moving_since_s])),
            "period_s": self._period_s,
            "reach": self._reach,
            "absent": [[interval, int(fault)] for interval, fault in self._absent.items()],
            "doubted": sorted(self._doubted),
            "untold": int(self._pending_fault),
            "last_kept": self._last_kept,
            "expected_faults": int(self._expected_faults),
            "channels": self._channels.snapshot(),
            "faults": self.faults,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        self._screen = _SCREEN.load(snapshot["screen"])
        since_s = float(decoded(snapshot["moving_since_s"], np.float64)[0])
        self._segment = _Segment(
            decoded(snapshot["rows"], np.float64).reshape(-1, 8),
            decoded(snapshot["fault"], np.int64),
            int(snapshot["first"]),
            int(snapshot["seen"]),
            MotionHistory(float(snapshot["direction"]), since_s),
        )
        self._period_s, self._reach = snapshot["period_s"], int(snapshot["reach"])
        self._absent = {int(interval): Fault(fault) for interval, fault in snapshot["absent"]}
        self._doubted = set(snapshot["doubted"])
        self._pending_fault = Fault(snapshot["untold"])
        self._last_kept = int(snapshot["last_kept"])
        self._expected_faults = Fault(snapshot["expected_faults"])
        self._channels.restore(snapshot["channels"])
        self.faults = dict(snapshot["faults"])

    @property
    def due_s(self) -> float:
        """Time of the sample that completes the current interval, s; -inf while it is unknown."""
        segment = self._segment
        if self._period_s is None or segment.first >= len(segment.rows):
            return -np.inf
        interval = self._interval_of(segment.rows[segment.first, T])
        end_s = (interval + 1 - _GRID_SLACK) * self._settings.interval_s
        return end_s + (self._reach - 0.5) * self._period_s

    def push(self, frame: SampleFrame) -> list[FeatureBlock]:
        """Take the next samples; return the intervals that they complete."""
        if len(frame) == 0:
            return []
        if self._screen is None:
            self._screen = RowScreen(has_torque=TORQUE in frame.channels)
            if not {ANGLE, TABLE_POSITION} <= set(frame.channels):
                self._expected_faults = ~_OF_TABLE  # one encoder only: nothing is missing
        self._note_doubts(frame)
        blocks: list[FeatureBlock] = []
        for part in self._screen.split(table_of(frame, self._ratio)):
            if part.new_clock:
                blocks += self._end_segment(Fault.TIME_BACKWARDS)
                self._period_s = None
                self._channels.forget()
                self._absent.clear()
                self._doubted.clear()
                self._last_kept = -sys.maxsize
            for time_s, fault in part.missing:
                interval = self._interval_of(time_s)
                self._absent[interval] = self._absent.get(interval, Fault.NONE) | fault
            blocks += self._take(part)
            if part.missing:
                blocks += self._absent_so_far(part.missing[-1][0])
        return blocks

    def _note_doubts(self, frame: SampleFrame) -> None:
        for name in frame.quality.keys() & _DOUBTED_CHANNELS:
            doubted = frame.time_s[is_uncertain(frame.quality[name])]
            self._doubted.update(map(self._interval_of, doubted[np.isfinite(doubted)]))
        if len(self._doubted) > _MOST_DOUBTED:  # nothing was summarised meanwhile
            self._doubted = set(sorted(self._doubted)[-_MOST_DOUBTED // 2 :])

    def _take(self, part: Screened) -> list[FeatureBlock]:
        """Append rows; part them where a gap is."""
        blocks: list[FeatureBlock] = []
        if len(part.rows) and not len(self._segment.rows):
            blocks += self._absent_before(self._interval_of(part.rows[0, T]))
        self._segment.append(part.rows, part.fault)
        if self._period_s is None and not self._learn_period():
            return blocks
        while (gap := self._next_gap()) is not None:
            rest = self._segment.split(gap)
            blocks += self._end_segment(Fault.GAP)
            blocks += self._absent_before(self._interval_of(rest.rows[0, T]))
            self._segment = rest
        return blocks + self._cut(look_ahead=self._reach)

    def _interval_of(self, time_s: float) -> int:
        return int(np.floor(time_s / self._settings.interval_s + _GRID_SLACK))

    def _absent_so_far(self, newest_s: float) -> list[FeatureBlock]:
        """Blocks of intervals that had rows, but none with the values that are needed."""
        rows = self._segment.rows
        blocks: list[FeatureBlock] = []
        if len(rows):
            longest_s = (self._settings.max_hole_rows + 0.5) * (self._period_s or 0.0)
            if self._period_s is None or newest_s - rows[-1, T] <= longest_s:
                return []
            last = self._interval_of(rows[-1, T])
            if self._interval_of(newest_s) <= last:
                return []
            blocks = self._end_segment(Fault.GAP)
        return blocks + self._absent_before(self._interval_of(newest_s))

    def _absent_before(self, before: int) -> list[FeatureBlock]:
        """Blocks of intervals below `before` that had rows, but none that could be kept."""
        earlier = sorted(interval for interval in self._absent if interval < before)
        faults = [(interval, self._absent.pop(interval)) for interval in earlier]
        return [
            self._count(absent_block(interval, self._settings.interval_s, fault))
            for interval, fault in faults
            if interval > self._last_kept
        ]

    def _learn_period(self) -> bool:
        rows = self._segment.rows
        if len(rows) < _LEARN_ROWS:
            return False
        self._period_s = float(np.median(np.diff(rows[:_LEARN_ROWS, T])))
        window_s = self._settings.plausibility.direction_window_s
        self._reach = max(1, round(window_s / self._period_s))
        return True

    def _next_gap(self) -> int | None:
        """First row after a gap that was not seen yet; marks the holes before it."""
        assert self._period_s is not None
        segment = self._segment
        start = max(segment.seen, 1)
        steps = np.diff(segment.rows[start - 1 :, T]) / self._period_s
        for hole in np.flatnonzero(steps > 1.5):
            if steps[hole] > self._settings.max_hole_rows + 0.5:
                return int(hole) + start
            segment.fault[int(hole) + start] |= int(Fault.HOLE)
        segment.seen = len(segment.rows)
        return None

    def _cut(self, look_ahead: int) -> list[FeatureBlock]:
        """Summarise the complete intervals of the segment and drop their rows."""
        segment = self._segment
        if self._period_s is None or len(segment.rows) < 2:
            return []
        blocks = []
        for end in self._interval_ends():
            if end + look_ahead >= len(segment.rows):
                break
            blocks.append(self._summarise(int(end)))
        segment.forget(self._reach)
        if self._absent:  # those before the current interval were bridged or reported
            current = self._interval_of(segment.rows[segment.first, T])
            self._absent = {i: lacking for i, lacking in self._absent.items() if i >= current}
        return blocks

    def _interval_ends(self) -> npt.NDArray[np.int64]:
        """Rows after the current interval's first at which another interval begins."""
        first = self._segment.first
        time_s = self._segment.rows[first:, T]
        interval = np.floor(time_s / self._settings.interval_s + _GRID_SLACK)
        return np.asarray(np.flatnonzero(np.diff(interval)) + 1 + first)

    def _summarise(self, end: int) -> FeatureBlock:
        """Block of the interval from the segment's first row up to the time of row `end`."""
        segment = self._segment
        inside = np.bitwise_or.reduce(segment.fault[segment.first + 1 : end + 1], initial=0)
        # the speeds at both ends lean on one row outside
        beside = np.bitwise_or.reduce(segment.fault[max(segment.first, 1) : end + 2], initial=0)
        block, segment.history = summarise(
            IntervalRows(segment.rows, segment.first, end, self._reach),
            Fault(int(inside)) | (Fault(int(beside)) & UNUSABLE),
            segment.history,
            self._settings.plausibility,
            self._channels,
        )
        interval = self._interval_of(segment.rows[segment.first, T])
        beyond = self._pending_fault | (Fault.DOUBTED if interval in self._doubted else Fault.NONE)
        if (self._period_s or 0.0) * _LEAST_SAMPLES > self._settings.interval_s * (1 + _GRID_SLACK):
            beyond |= Fault.SPARSE
        self._pending_fault, segment.first = Fault.NONE, end
        self._doubted = {later for later in self._doubted if later > interval}
        fault = (block.fault | beyond) & self._expected_faults
        return self._count(block if fault == block.fault else replace(block, fault=fault))

    def _count(self, block: FeatureBlock) -> FeatureBlock:
        for fault in block.fault:
            self.faults[str(fault.name)] = self.faults.get(str(fault.name), 0) + 1
        return block

    def _end_segment(self, reason: Fault) -> list[FeatureBlock]:
        """Close the segment: its last, open interval carries the reason as fault."""
        blocks = self._cut(look_ahead=0)
        segment = self._segment
        if self._period_s is not None and len(segment.rows) - 1 > segment.first:
            segment.fault[-1] |= int(reason)
            blocks.append(self._summarise(len(segment.rows) - 1))
        elif len(segment.rows):
            self._pending_fault = reason  # slow samples: no interval is left to report the gap
        if len(segment.rows):
            self._last_kept = self._interval_of(segment.rows[-1, T])
        self._channels.interrupt()
        self._segment = _Segment()
        return blocks
