"""Current behaviour of an axis: the newest interval, the last minutes, each channel's state."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct

from ..messages.features import Fault, FeatureBlock
from .inputs import fault_name

KEPT = 3000
_QUALITY_MEMORY = 600
_LOST_BY = {
    "torque": Fault.NO_TORQUE | Fault.TORQUE_STUCK | Fault.TORQUE_HELD,
    "motor angle": Fault.NO_POSITION | Fault.ANGLE_STUCK | Fault.ANGLE_HELD,
    "table position": Fault.NO_TABLE,
}
_CHANNELS = (*_LOST_BY, "temperature", "external force")
_PACKED = Struct("q5dq")
"""A `LivePoint`: time, its numbers, bits of Fault; a tenth of the memory of objects."""
_DOUBTFUL = Fault.GAP | Fault.TIME_BACKWARDS | Fault.IMPLAUSIBLE


@dataclass(frozen=True, slots=True)
class LivePoint:
    """One interval as people look at it; a number that was not measured is None."""

    time_ns: int  # UNIX time of its end, ns
    torque_nm: float | None
    speed_rad_s: float | None
    position_m: float | None
    # table position less the travel of the screw, m; its zero has no meaning
    transmission_m: float | None
    temperature_c: float | None
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChannelQuality:
    """One channel over the last minute."""

    channel: str
    state: str  # `ok`, `faulty` (in some intervals), `missing` (in the newest)
    good_share: float  # share of intervals in which it was measured and plausible, 0 to 1


class LiveFeatures:
    """The last intervals of one axis, in bounded memory."""

    def __init__(self, ratio_m_per_rad: float | None) -> None:
        self._ratio = math.nan if ratio_m_per_rad is None else ratio_m_per_rad
        self._points: deque[bytes] = deque(maxlen=KEPT)
        self._good: deque[tuple[bool, ...]] = deque(maxlen=_QUALITY_MEMORY)
        self._present: tuple[bool, ...] = ()
        self.temperature_c = math.nan

    def add(self, time_ns: int, block: FeatureBlock) -> None:
        position, way = block.table_mean_m, block.angle_mean_rad * self._ratio
        self.temperature_c = block.temperature_c
        speed = 0.5 * (block.speed_start_rad_s + block.speed_end_rad_s)
        shown = position if math.isfinite(position) else way
        numbers = (block.torque_mean_nm, speed, shown, position - way, block.temperature_c)
        self._points.append(_PACKED.pack(time_ns, *numbers, block.fault))
        self._present = _present(block)
        is_sure = not block.fault & _DOUBTFUL
        self._good.append(tuple(each and is_sure for each in self._present))

    @property
    def newest(self) -> LivePoint | None:
        """The newest interval; None before the first."""
        return _point(self._points[-1]) if self._points else None

    def since(self, time_ns: int) -> Iterator[LivePoint]:
        """Intervals that end after a time, oldest first."""
        return (_point(each) for each in self._points if _PACKED.unpack(each)[0] > time_ns)

    def channels(self) -> tuple[ChannelQuality, ...]:
        """State of each channel; empty before the first interval."""
        found = []
        for k, (name, present) in enumerate(zip(_CHANNELS, self._present, strict=False)):
            share = sum(each[k] for each in self._good) / len(self._good)
            state = "missing" if not present else "ok" if share == 1.0 else "faulty"
            found.append(ChannelQuality(name, state, share))
        return tuple(found)


def _point(packed: bytes) -> LivePoint:
    time_ns, *numbers, bits = _PACKED.unpack(packed)
    torque, speed, position, transmission, temperature = map(_shown, numbers)
    faults = tuple(fault_name(kind) for kind in Fault(bits))
    return LivePoint(time_ns, torque, speed, position, transmission, temperature, faults)


def _shown(value: float) -> float | None:
    """A measured value to seven digits: more than any was measured with."""
    return float(f"{value:.7g}") if math.isfinite(value) else None


def _present(block: FeatureBlock) -> tuple[bool, ...]:
    named = Fault.TORQUE_STUCK | Fault.ANGLE_STUCK
    stuck = bool(block.fault & Fault.STUCK) and not block.fault & named
    known = [not block.fault & fault and not stuck for fault in _LOST_BY.values()]
    known[1] = known[1] and math.isfinite(block.angle_mean_rad)
    more = (block.temperature_c, block.external_force_n)
    return (*known, *(math.isfinite(each) for each in more))
