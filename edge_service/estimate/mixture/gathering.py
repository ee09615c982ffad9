"""Gathering of short intervals of steady motion until they last a tenth of a second.

The noise that a filter assumes holds for phases of about that length; their mean is exact.
"""

from dataclasses import astuple, dataclass
from typing import Any

from ...messages.features import PHASE_FIELDS, FeatureBlock, Phase
from ...messages.stored import Number, Stored

WHOLE_S = 0.1
_CLOSE = 1e-6
_Numbers = tuple[Number, Number, Number, Number]
_Phase = tuple[Number, Number, Number, Number, Number, Number]
_STORED: Stored[tuple[_Numbers, list[_Phase]]] = Stored(tuple[_Numbers, list[_Phase]])


@dataclass(frozen=True, slots=True)
class SteadyInterval:
    """Steady motion of one interval, or of several that follow one another; see FeatureBlock.

    Attributes:
        phases: accelerating, cruising, braking; of no time where there was none.
    """

    time_s: float
    duration_s: float
    direction: float
    external_force_n: float
    phases: tuple[Phase, ...]


def gathered(
    waiting: SteadyInterval | None, block: FeatureBlock
) -> tuple[list[SteadyInterval], SteadyInterval | None]:
    """Intervals that are complete with a block, the earliest first, and the one that still waits.

    Another direction, a gap or a rest ends what waits.
    """
    done = [] if waiting is None else [waiting]
    if not block.usable or block.steady_direction == 0.0:
        return done, None
    phases = (block.accelerating, block.cruising, block.braking)
    time = (block.time_s, block.duration_s)
    interval = SteadyInterval(*time, block.steady_direction, block.external_force_n, phases)
    if waiting is not None and interval.direction == waiting.direction:
        gap_s = abs(interval.time_s - interval.duration_s - waiting.time_s)
        if gap_s < 0.1 * interval.duration_s:
            interval, done = _joined(waiting, interval), []
    if interval.duration_s >= WHOLE_S - _CLOSE:
        return [*done, interval], None
    return done, interval


def _joined(one: SteadyInterval, other: SteadyInterval) -> SteadyInterval:
    duration_s = one.duration_s + other.duration_s
    force = one.external_force_n * one.duration_s + other.external_force_n * other.duration_s
    phases = tuple(_mean(*pair) for pair in zip(one.phases, other.phases, strict=True))
    return SteadyInterval(other.time_s, duration_s, other.direction, force / duration_s, phases)


def _mean(one: Phase, other: Phase) -> Phase:
    """Mean of two phases by their time."""
    if one.steady_s == 0.0 or other.steady_s == 0.0:
        return other if one.steady_s == 0.0 else one
    whole_s = one.steady_s + other.steady_s
    means = (
        (getattr(one, name) * one.steady_s + getattr(other, name) * other.steady_s) / whole_s
        for name in PHASE_FIELDS[1:]
    )
    return Phase(whole_s, *means)


def interval_snapshot(waiting: SteadyInterval | None) -> list[Any] | None:
    """Waiting interval as JSON-able values."""
    if waiting is None:
        return None
    *numbers, phases = astuple(waiting)
    return list(_STORED.dump((tuple(numbers), list(phases))))


def restored_interval(snapshot: list[Any] | None) -> SteadyInterval | None:
    """Waiting interval of a snapshot; ValueError if it is none."""
    if snapshot is None:
        return None
    numbers, phases = _STORED.load(snapshot)
    return SteadyInterval(*numbers, tuple(Phase(*phase) for phase in phases))
