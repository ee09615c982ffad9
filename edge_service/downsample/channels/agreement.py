"""Agreement of the linear encoder with the way of the screw, within the limits of a sound axis."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ...messages.stored import Packed
from ..rows import THETA, T, U, X
from .channel_limits import ChannelLimits

CHUNKS = 10
"""Pieces of an interval: the mean of each is free of chatter, and still tells a short fault."""
SLOPE = 2e-3
"""The worst lead and the longest screw's growth are half of this, a scale to be found 1 %."""
LAG_S = 3.5e-3
"""Between a skew that the estimator follows (2 ms) and a lag that is a fault (5 ms)."""
BRAKING_RAD_S2 = 30.0
"""Braking harder than this may lift the table off the flank of the nut that pushes it."""
RESTING_RAD_S = 0.05


@dataclass(frozen=True, slots=True)
class Chunk:
    """Means over a few rows.

    Attributes:
        parted_m: way of the screw less that of the table, less the skew that is known.
        way_m: of the screw.
    """

    time_s: float
    parted_m: float
    way_m: float
    speed_m_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class Roughness:
    """Contribution of the channels themselves to the parting of the encoders.

    Attributes:
        noise_m: of their difference from row to row.
        lag_s: longest for which a slow channel holds a value.
        span_nm: between the least and the largest torque around the interval.
    """

    noise_m: float = 0.0
    lag_s: float = 0.0
    span_nm: float = np.nan


def chunks_of(rows: Floats, limits: ChannelLimits) -> list[Chunk]:
    """Means over the pieces of rows (n + 1, 8); the last row only ends the last piece."""
    count = len(rows) - 1
    edges: npt.NDArray[np.int64] = np.unique(
        np.linspace(0, count, min(CHUNKS, count) + 1).astype(np.int64)
    )
    way = rows[:, THETA] * limits.ratio_m_per_rad
    speed = np.diff(way[edges]) / np.diff(rows[edges, T])
    columns = np.column_stack([rows[:-1, T], way[:-1] - rows[:-1, X], way[:-1], rows[:-1, U]])
    sums = np.add.reduceat(columns, edges[:-1], axis=0)
    time_s, parted, way_m, torque = (sums / np.diff(edges)[:, None]).T
    means = zip(time_s, parted - limits.skew_s * speed, way_m, speed, torque, strict=True)
    return [Chunk(*map(float, each)) for each in means]


def rests(chunk: Chunk, limits: ChannelLimits) -> bool:
    """True if the screw stands still."""
    return abs(chunk.speed_m_s) <= RESTING_RAD_S * limits.ratio_m_per_rad


@dataclass(slots=True)
class Contact:
    """Contact of the nut: pushing the table with the same flank all the while, or not.

    Attributes:
        pushed_from_m: way of the screw at which it began to push; NaN while it does not.
    """

    direction: float = 0.0
    speed_m_s: float = np.nan
    time_s: float = np.nan
    pushed_from_m: float = np.nan

    def follow(self, chunk: Chunk, limits: ChannelLimits, span_nm: float) -> bool:
        """Take the next piece of the motion; True once it pushed beyond play and stretch."""
        along = np.sign(chunk.speed_m_s) * (not rests(chunk, limits))
        gained_m_s = (chunk.speed_m_s - self.speed_m_s) * along
        most_m_s = BRAKING_RAD_S2 * limits.ratio_m_per_rad * (chunk.time_s - self.time_s)
        pushing = along != 0.0 and along == self.direction and chunk.torque_nm * along > 0.0
        pushing = pushing and gained_m_s >= -most_m_s
        self.direction, self.speed_m_s, self.time_s = float(along), chunk.speed_m_s, chunk.time_s
        if not pushing:
            self.pushed_from_m = np.nan
            return False
        if np.isnan(self.pushed_from_m):
            self.pushed_from_m = chunk.way_m
            return False
        hidden_m = limits.play_m + limits.stretch_m(max(span_nm, abs(chunk.torque_nm)))
        return bool(abs(chunk.way_m - self.pushed_from_m) >= hidden_m)


@dataclass(slots=True)
class AgreementState:
    """Everything on which the next piece is compared, see Agreement.

    Attributes:
        contact: of the nut.
        closed: no play can hide between the encoders.
        anchors: earlier pieces by name.
    """

    contact: Annotated[Contact, Packed()] = field(default_factory=Contact)
    closed: bool = False
    anchors: dict[str, Annotated[Chunk, Packed()]] = field(default_factory=dict)


class Agreement:
    """Comparison of both encoders with earlier pieces at which they agreed.

    `held` is the last piece of pushed motion, `rest` the last one at rest: a reversal may add the
    play to them. `begun` is where the present push began and `newest` its last piece: nothing may
    be added to them but what goes with way, torque and speed.
    """

    def __init__(self, limits: ChannelLimits, state: AgreementState | None = None) -> None:
        self._limits = limits
        self.state = state or AgreementState()

    def forget(self) -> None:
        """Forget all earlier pieces."""
        self.state = AgreementState()

    def interrupt(self) -> None:
        """Take a gap: the present push may have ended."""
        self.state.contact, self.state.closed = Contact(), False
        self._anchors.pop("begun", None)
        self._anchors.pop("newest", None)

    @property
    def _anchors(self) -> dict[str, Chunk]:
        return self.state.anchors

    @property
    def closed(self) -> bool:
        """True while no play can hide between the encoders."""
        return self.state.closed

    def parted_m(self, chunk: Chunk, rough: Roughness) -> float:
        """Take the next piece; parting of the encoders beyond a sound axis' limits, m, or 0."""
        state = self.state
        state.closed = state.contact.follow(chunk, self._limits, rough.span_nm)
        if not state.closed:
            self._anchors.pop("begun", None)
            self._anchors.pop("newest", None)
        for anchor, play_m in self._compared(chunk):
            parted_m = abs(chunk.parted_m - anchor.parted_m)
            if parted_m > play_m + self.allowed_m(anchor, chunk, rough):
                return parted_m
        self._remember(chunk)
        return 0.0

    def is_elsewhere(self, chunk: Chunk, rough: Roughness) -> bool:
        """True if a piece lies at another level than the last that agreed."""
        return any(
            abs(chunk.parted_m - anchor.parted_m)
            > self._limits.play_m + self.allowed_m(anchor, chunk, rough)
            for anchor in (
                self._anchors[name] for name in ("held", "rest") if name in self._anchors
            )
        )

    def allowed_m(self, anchor: Chunk, chunk: Chunk, rough: Roughness) -> float:
        """Most by which a sound axis parts its encoders between two pieces, without play, m."""
        limits = self._limits
        span_nm = max(rough.span_nm, abs(chunk.torque_nm - anchor.torque_nm))
        periodic_m = limits.periodic_m
        return (
            periodic_m
            + 3.0 * rough.noise_m
            + limits.stretch_m(span_nm)
            + limits.growth_m(chunk.time_s - anchor.time_s)
            + SLOPE * abs(chunk.way_m - anchor.way_m)
            + (LAG_S + rough.lag_s) * abs(chunk.speed_m_s - anchor.speed_m_s)
        )

    def _compared(self, chunk: Chunk) -> list[tuple[Chunk, float]]:
        names = ["held", "begun", "newest"]
        if rests(chunk, self._limits):
            names.append("rest")
        play = {"held": self._limits.play_m, "rest": self._limits.play_m}
        return [
            (self._anchors[name], play.get(name, 0.0)) for name in names if name in self._anchors
        ]

    def _remember(self, chunk: Chunk) -> None:
        self._anchors.setdefault("held", chunk)
        if rests(chunk, self._limits):
            self._anchors["rest"] = chunk
        if self.closed:
            self._anchors.setdefault("begun", chunk)
            self._anchors["newest"] = self._anchors["held"] = chunk
