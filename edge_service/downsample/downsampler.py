"""Downsampling of screened rows to statistics of intervals on a fixed grid of time."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, PlainSerializer, PlainValidator

from ..checks.live.channel_check import WITHOUT_TABLE, ChannelCheck, ChannelState
from ..checks.live.channel_limits import ChannelLimits
from ..checks.live.excursions import BEFORE, BEHIND, FIRST, longest_rows, mend
from ..messages.features import UNUSABLE, Fault, FeatureBlock
from ..messages.row_faults import T
from ..messages.samples import POSITION_CHANNELS, TORQUE, Floats, SampleFrame, is_uncertain
from ..messages.stored import Stored, StoredFloats
from .interval_kernels import CLOCK_STATES, PERIOD_S, ends, even_out, mark_holes
from .rows import Bits, RowScreen, Screened, table_of
from .statistics import MAX_SPEED_RAD_S, DownsampleSettings, MotionHistory, absent_block, summarise

_LEARN_ROWS = 16  # rows from which the native period is learned
_DOUBTED_CHANNELS = {TORQUE, *POSITION_CHANNELS}
_MAX_HOLE_ROWS = 6  # native periods without a row that are bridged; more is a gap
_DIRECTION_WINDOW_S = 0.004  # half width of the difference that gives the direction
_LEAST_SAMPLES = 5  # in an interval, for the torque held between them to be a fair picture
_MOST_DOUBTED = 1024
_OF_TABLE = WITHOUT_TABLE | Fault.NO_TABLE | Fault.TABLE_SHIFTED | Fault.TABLE_OUTLIERS
_GRID_SLACK = 1e-4  # share of an interval by which a time stamp may fall short of the grid
_SNAPSHOT_SCHEMA: Literal["downsampler/6"] = "downsampler/6"


_Rows = Annotated[StoredFloats, AfterValidator(lambda rows: rows.reshape(-1, 8))]
_Faults = Annotated[
    Bits,
    PlainValidator(lambda faults: np.array(faults, np.int64)),
    PlainSerializer(lambda faults: faults.tolist()),
]


@dataclass(slots=True, eq=False)
class _Segment:
    """Rows without a gap between them."""

    # (n, 8), from the reach before the current interval on
    rows: _Rows = field(default_factory=lambda: np.empty((0, 8)))
    # (n,), bits of Fault found just before each row
    fault: _Faults = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    first: int = 0  # first row of the current interval
    seen: int = 0  # rows that were searched for gaps
    mended: int = 0  # rows that were searched for samples that no drive can make
    history: MotionHistory = field(default_factory=MotionHistory)  # before the current interval

    def split(self, row: int) -> "_Segment":
        """Cut before `row`; return what followed."""
        rest = _Segment(self.rows[row:], self.fault[row:])
        self.rows, self.fault = self.rows[:row], self.fault[:row]
        return rest

    def mend(self, longest: int, stop: int) -> None:
        """Replace samples that no drive can make, of the rows before `stop`."""
        self.fault |= mend(self.rows, self.mended, stop, longest)
        self.mended = max(self.mended, stop)

    def forget(self, reach: int) -> None:
        """Keep only what later differences need."""
        drop = max(0, min(self.first, self.mended) - reach - 1)
        self.rows, self.fault = self.rows[drop:], self.fault[drop:]
        self.first -= drop
        self.seen = max(0, self.seen - drop)
        self.mended = max(0, self.mended - drop)


@dataclass(slots=True, eq=False)
class _State:
    """Everything that the next samples meet, as it is stored."""

    schema: Literal["downsampler/6"] = _SNAPSHOT_SCHEMA
    screen: RowScreen | None = None
    segment: _Segment = field(default_factory=_Segment)
    period_s: float | None = None
    clock: StoredFloats = field(default_factory=lambda: np.zeros(CLOCK_STATES))  # of `even_out`
    reach: int = 1
    longest: int = 0  # rows of the longest excursion that is looked for
    ahead: int = 1  # rows behind an interval that its statistics and that search need
    absent: dict[int, int] = field(default_factory=dict)  # interval -> Fault of what its rows lack
    # intervals with samples that the source doubts
    doubted: Annotated[set[int], PlainSerializer(sorted)] = field(default_factory=set)
    pending_fault: int = 0  # end of a segment without an interval left to report it
    last_kept: int = -sys.maxsize  # interval of the last row that was kept
    expected_faults: int = -1  # bits of Fault that can be
    channels: ChannelState = field(default_factory=ChannelState)
    faults: dict[str, int] = field(default_factory=dict)  # name of a fault -> intervals that had it


_STORED: Stored[_State] = Stored(_State)


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
            settings.channels or ChannelLimits.of_ratio(ratio_m_per_rad), MAX_SPEED_RAD_S
        )
        self._state = _State()

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values; `restore` of it goes on bit-equal."""
        self._state.channels = self._channels.state
        return dict(_STORED.dump(self._state))

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        self._state = _STORED.load(snapshot)
        self._channels.state = self._state.channels

    @property
    def faults(self) -> Mapping[str, int]:
        """Name of a fault -> intervals that had it."""
        return self._state.faults

    @property
    def hold_s(self) -> Floats:
        """Mean time for which torque, motor angle and table repeat a value, s, (3,)."""
        return self._channels.state.hold_s

    @property
    def due_s(self) -> float:
        """Time of the sample that completes the current interval, s; -inf while it is unknown."""
        state, segment = self._state, self._state.segment
        if state.period_s is None or segment.first >= len(segment.rows):
            return -np.inf
        interval = self._interval_of(segment.rows[segment.first, T])
        end_s = (interval + 1 - _GRID_SLACK) * self._settings.interval_s
        return end_s + (state.ahead - 0.5) * state.period_s

    def push(self, frame: SampleFrame) -> list[FeatureBlock]:
        """Take the next samples; return the intervals that they complete."""
        if len(frame) == 0:
            return []
        state = self._state
        if state.screen is None:
            state.screen = RowScreen(has_torque=TORQUE in frame.channels)
            if not {*POSITION_CHANNELS} <= set(frame.channels):
                state.expected_faults = int(~_OF_TABLE)  # one encoder only: nothing is missing
        for name in frame.quality.keys() & _DOUBTED_CHANNELS:
            doubted = frame.time_s[is_uncertain(frame.quality[name])]
            state.doubted.update(map(self._interval_of, doubted[np.isfinite(doubted)]))
        if len(state.doubted) > _MOST_DOUBTED:  # nothing was summarised meanwhile
            state.doubted = set(sorted(state.doubted)[-_MOST_DOUBTED // 2 :])
        blocks: list[FeatureBlock] = []
        for part in state.screen.split(table_of(frame, self._ratio)):
            if part.new_clock:
                blocks += self._end_segment(Fault.NONE)
                state.period_s = None
                self._channels.state = ChannelState()
                state.absent.clear()
                state.doubted.clear()
                state.last_kept = -sys.maxsize
            for time_s, fault in part.missing:
                interval = self._interval_of(time_s)
                state.absent[interval] = state.absent.get(interval, 0) | int(fault)
            blocks += self._take(part)
            if part.missing:
                blocks += self._absent_so_far(part.missing[-1][0])
        return blocks

    def _take(self, part: Screened) -> list[FeatureBlock]:
        """Append rows; part them where a gap is."""
        blocks: list[FeatureBlock] = []
        state, segment = self._state, self._state.segment
        if len(part.rows) and not len(segment.rows):
            blocks += self._absent_before(self._interval_of(part.rows[0, T]))
        segment.rows = np.concatenate([segment.rows, part.rows])
        segment.fault = np.concatenate([segment.fault, part.fault])
        fresh = segment.rows[len(segment.rows) - len(part.rows) :]
        if state.period_s is None:
            if len(segment.rows) < _LEARN_ROWS:
                return blocks
            fresh, steps_s = segment.rows, np.diff(segment.rows[:_LEARN_ROWS, T])
            state.clock = np.zeros(CLOCK_STATES)
            state.clock[PERIOD_S], state.period_s = np.mean(steps_s), float(np.median(steps_s))
            state.reach = max(1, round(_DIRECTION_WINDOW_S / state.period_s))
            state.longest = longest_rows(state.period_s)
            state.ahead = state.reach + (state.longest + BEHIND if state.longest else 0)
        even_out(fresh, state.clock)
        while (gap := self._next_gap(state.period_s)) < len(state.segment.rows):
            rest = state.segment.split(gap)
            blocks += self._end_segment(Fault.GAP)
            blocks += self._absent_before(self._interval_of(rest.rows[0, T]))
            state.segment = rest
        return blocks + self._cut(state.ahead)

    def _interval_of(self, time_s: float) -> int:
        return int(np.floor(time_s / self._settings.interval_s + _GRID_SLACK))

    def _absent_so_far(self, newest_s: float) -> list[FeatureBlock]:
        """Blocks of intervals that had rows, but none with the values that are needed."""
        rows, period_s = self._state.segment.rows, self._state.period_s
        blocks: list[FeatureBlock] = []
        if len(rows):
            longest_s = (_MAX_HOLE_ROWS + 0.5) * (period_s or 0.0)
            is_later = self._interval_of(newest_s) > self._interval_of(rows[-1, T])
            if period_s is None or newest_s - rows[-1, T] <= longest_s or not is_later:
                return []
            blocks = self._end_segment(Fault.GAP)
        return blocks + self._absent_before(self._interval_of(newest_s))

    def _absent_before(self, before: int) -> list[FeatureBlock]:
        """Blocks of intervals below `before` that had rows, but none that could be kept."""
        state = self._state
        earlier = sorted(interval for interval in state.absent if interval < before)
        faults = [(interval, Fault(state.absent.pop(interval))) for interval in earlier]
        return [
            self._count(absent_block(interval, self._settings.interval_s, fault))
            for interval, fault in faults
            if interval > state.last_kept
        ]

    def _next_gap(self, period_s: float) -> int:
        """First row after a gap that was not seen yet; marks the holes before it."""
        segment = self._state.segment
        rows, fault, start = segment.rows, segment.fault, max(segment.seen, 1)
        gap = mark_holes(rows, fault, start, period_s, _MAX_HOLE_ROWS)
        segment.seen = len(rows) if gap == len(rows) else segment.seen
        return gap

    def _cut(self, look_ahead: int) -> list[FeatureBlock]:
        """Summarise the complete intervals of the segment and drop their rows."""
        state, segment = self._state, self._state.segment
        if state.period_s is None or len(segment.rows) < 2:
            return []
        blocks = []
        segment.mend(state.longest, len(segment.rows) - look_ahead + state.reach * bool(look_ahead))
        grid_s = self._settings.interval_s
        for end in ends(segment.rows, segment.first, grid_s, _GRID_SLACK).tolist():
            if end + look_ahead >= len(segment.rows):
                break
            blocks.append(self._summarise(end))
        segment.forget(max(state.reach, BEFORE + FIRST))
        if state.absent:  # those before the current interval were bridged or reported
            current = self._interval_of(segment.rows[segment.first, T])
            state.absent = {i: lacking for i, lacking in state.absent.items() if i >= current}
        return blocks

    def _summarise(self, end: int) -> FeatureBlock:
        """Block of the interval from the segment's first row up to the time of row `end`."""
        state, segment, interval_s = self._state, self._state.segment, self._settings.interval_s
        inside = np.bitwise_or.reduce(segment.fault[segment.first + 1 : end + 1], initial=0)
        # the speeds at both ends lean on one row outside
        beside = np.bitwise_or.reduce(segment.fault[max(segment.first, 1) : end + 2], initial=0)
        block, segment.history = summarise(
            segment.rows,
            segment.first,
            end,
            state.reach,
            Fault(int(inside) | int(beside) & int(UNUSABLE)),
            segment.history,
            self._settings,
            self._channels,
        )
        interval = self._interval_of(segment.rows[segment.first, T])
        beyond = Fault(state.pending_fault | Fault.DOUBTED * (interval in state.doubted))
        if (state.period_s or 0.0) * _LEAST_SAMPLES > interval_s * (1 + _GRID_SLACK):
            beyond |= Fault.SPARSE
        state.pending_fault, segment.first = 0, end
        state.doubted = {later for later in state.doubted if later > interval}
        fault = (block.fault | beyond) & state.expected_faults
        return self._count(block if fault == block.fault else replace(block, fault=fault))

    def _count(self, block: FeatureBlock) -> FeatureBlock:
        counts = self._state.faults
        for fault in block.fault:
            counts[str(fault.name)] = counts.get(str(fault.name), 0) + 1
        return block

    def _end_segment(self, reason: Fault) -> list[FeatureBlock]:
        """Close the segment: its last, open interval carries the reason as fault, or is none."""
        blocks = self._cut(look_ahead=0)
        state, segment = self._state, self._state.segment
        if reason and state.period_s is not None and len(segment.rows) - 1 > segment.first:
            segment.fault[-1] |= int(reason)
            blocks.append(self._summarise(len(segment.rows) - 1))
        elif len(segment.rows):
            state.pending_fault = int(reason)  # slow samples: no interval is left to report the gap
        if len(segment.rows):
            state.last_kept = self._interval_of(segment.rows[-1, T])
        self._channels.interrupt()
        state.segment = _Segment()
        return blocks
