"""Gathering of short intervals of steady motion until they last a tenth of a second.

The noise that a filter assumes holds for phases of about that length; a mean over phases is exact,
so only time is lost.
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
    """Steady motion of one interval, or of several that follow one another.

    Attributes:
        time_s: its end on the axis' clock, s.
        duration_s: s.
        direction: -1 or 1.
        external_force_n: NaN where it is not measured.
        phases: accelerating, cruising, braking; of no time where there was none.
    """

    time_s: float
    duration_s: float
    direction: float
    external_force_n: float
    phases: tuple[Phase, ...]

    @classmethod
    def of(cls, block: FeatureBlock) -> "SteadyInterval":
        """Steady interval of a block."""
        return cls(
            block.time_s,
            block.duration_s,
            block.steady_direction,
            block.external_force_n,
            (block.accelerating, block.cruising, block.braking),
        )

    def followed_by(self, other: "SteadyInterval") -> "SteadyInterval":
        """Both intervals as one."""
        duration_s = self.duration_s + other.duration_s
        force = self.external_force_n * self.duration_s + other.external_force_n * other.duration_s
        return SteadyInterval(
            other.time_s,
            duration_s,
            other.direction,
            force / duration_s,
            tuple(_both(*pair) for pair in zip(self.phases, other.phases, strict=True)),
        )

    def continues(self, before: "SteadyInterval") -> bool:
        """Return whether this interval begins where another has ended, in the same direction."""
        gap_s = abs(self.time_s - self.duration_s - before.time_s)
        return self.direction == before.direction and gap_s < 0.1 * self.duration_s


def _both(one: Phase, other: Phase) -> Phase:
    """Mean of two phases by their time."""
    if one.steady_s == 0.0 or other.steady_s == 0.0:
        return other if one.steady_s == 0.0 else one
    whole_s = one.steady_s + other.steady_s
    means = (
        (getattr(one, name) * one.steady_s + getattr(other, name) * other.steady_s) / whole_s
        for name in PHASE_FIELDS[1:]
    )
    return Phase(whole_s, *means)


class Gathering:
    """Intervals of one axis on their way to its filter."""

    def __init__(self) -> None:
        self._waiting: SteadyInterval | None = None

    def take(self, block: FeatureBlock) -> list[SteadyInterval]:
        """Intervals that are complete now, the earliest first."""
        steady = block.usable and block.steady_direction != 0.0
        if not steady:
            return self._let_go()
        interval, done = SteadyInterval.of(block), []
        if self._waiting is not None and interval.continues(self._waiting):
            interval = self._waiting.followed_by(interval)
            self._waiting = None
        else:
            done = self._let_go()
        if interval.duration_s >= WHOLE_S - _CLOSE:
            return [*done, interval]
        self._waiting = interval
        return done

    def _let_go(self) -> list[SteadyInterval]:
        waiting, self._waiting = self._waiting, None
        return [] if waiting is None else [waiting]

    def snapshot(self) -> list[Any] | None:
        """Waiting interval as JSON-able values."""
        if self._waiting is None:
            return None
        *numbers, phases = astuple(self._waiting)
        return list(_STORED.dump((tuple(numbers), list(phases))))

    def restore(self, snapshot: list[Any] | None) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        self._waiting = None
        if snapshot is not None:
            numbers, phases = _STORED.load(snapshot)
            self._waiting = SteadyInterval(*numbers, tuple(Phase(*phase) for phase in phases))
