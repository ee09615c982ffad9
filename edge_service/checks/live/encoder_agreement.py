"""Agreement of the linear encoder with the screw, piece by piece, within a sound axis' limits."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from ...messages.row_faults import THETA, T, U, X
from ...messages.samples import Floats
from ...messages.stored import StoredFloats
from ...models.compiled import compiled
from .channel_limits import GROWTH_PER_LENGTH_S, MOST_GROWTH
from .repeats import OpenRun, followed, standing

CHUNKS = 10
"""Pieces of an interval: the mean of each is free of chatter, and still tells a short fault."""
SLOPE = 2e-3
"""The worst lead and the longest screw's growth are half of this, a scale to be found 1 %."""
LAG_S = 3.5e-3
"""Between a skew that the estimator follows (2 ms) and a lag that is a fault (5 ms)."""
BRAKING_RAD_S2 = 30.0
"""Braking harder than this may lift the table off the flank of the nut that pushes it."""
RESTING_RAD_S = 0.05

TIME, PARTED, WAY, SPEED, TORQUE = range(5)
"""Columns of pieces: means of time s, way of the screw less that of the table m, less the skew
that is known, way of the screw m, speed m/s, torque N m."""
HELD, REST, BEGUN, NEWEST = range(4)
"""Rows of anchors: earlier pieces, NaN where there is none."""
DIRECTION, PUSHED_SPEED, PUSHED_TIME, PUSHED_FROM, CLOSED = range(5)
"""Places of the contact's state."""
RATIO, PLAY, PERIODIC, LENGTH, STRETCH, SKEW = range(6)
"""Places of the limits: as `ChannelLimits`; stretch per torque."""
NOISE, LAG, SPAN = range(3)
"""Places of the channels' roughness: noise of the encoders' difference from row to row, m; longest
hold of a slow channel, s; span of the torque around the interval, N m, NaN if unknown."""
_FREE = (0.0, np.nan, np.nan, np.nan, 0.0)
"""Contact of a nut that pushes nothing."""


_Contact = Annotated[StoredFloats, AfterValidator(lambda each: each.reshape(5))]
_Anchors = Annotated[StoredFloats, AfterValidator(lambda each: each.reshape(4, 5))]


@dataclass(slots=True, eq=False)
class Agreement:
    """Comparison of both encoders with earlier pieces at which they agreed.

    `held` is the last piece of pushed motion, `rest` the last one at rest: a reversal may add the
    play to them. `begun` is where the present push began and `newest` its last piece: nothing may
    be added to them but what goes with way, torque and speed.
    """

    # of the nut: pushing the table with the same flank all the while, or not, (5,)
    contact: _Contact = field(default_factory=lambda: np.array(_FREE))
    # earlier pieces, (4, 5)
    anchors: _Anchors = field(default_factory=lambda: np.full((4, 5), np.nan))

    def interrupt(self) -> None:
        """Take a gap: the present push may have ended."""
        self.contact[:] = _FREE
        self.anchors[[BEGUN, NEWEST]] = np.nan

    def is_elsewhere(self, piece: Floats, limits: Floats, rough: Floats) -> bool:
        """Piece at another level than the last that agreed."""
        return any(
            abs(piece[PARTED] - each[PARTED])
            > limits[PLAY] + _allowed_m(each, piece, limits, rough)
            for each in self.anchors[[HELD, REST]]
        )


@compiled
def measured(
    inside: Floats, ahead: Floats, limits: Floats, table_run: OpenRun, angle_run: OpenRun
) -> tuple[Floats, Floats, OpenRun, OpenRun]:
    """Pieces of an interval, (k, 5), its numbers, (8,), and the runs in which table and angle end.

    Greatest step, rad/s, and speed, m/s; travel while the angle stood, while the table did, and in
    its open run, m; noise between the encoders and way of the screw, m; share in motion.
    """
    pieces = pieces_of(inside, limits[RATIO], limits[SKEW])
    later = ahead[~np.isnan(ahead[:, X])]
    way, table = inside[:, THETA] * limits[RATIO], inside[:, X].copy()
    ways = np.concatenate((way, later[:, THETA] * limits[RATIO]))
    steps = inside[1:] - inside[:-1]
    fastest = np.max(np.abs(steps[:, THETA] / steps[:, T]))
    angle_m, _ = standing(way, table, angle_run)
    table_m, open_m = standing(np.concatenate((table, later[:, X])), ways, table_run)
    noise_m = np.median(np.abs(np.diff(way - table)))
    speeds = np.abs(pieces[:, SPEED])
    moving = np.mean(speeds > RESTING_RAD_S * limits[RATIO])
    found = (fastest, np.max(speeds), angle_m, table_m, open_m, noise_m, np.ptp(way), moving)
    runs = followed(table[:-1], way[:-1], table_run), followed(way[:-1], table[:-1], angle_run)
    return pieces, np.array(found), runs[0], runs[1]


@compiled
def pieces_of(rows: Floats, ratio_m_per_rad: float, skew_s: float) -> Floats:
    """Means over the pieces of rows (n + 1, 8), (k, 5); the last row only ends the last piece."""
    count = len(rows) - 1
    pieces = min(CHUNKS, count)
    found, step, start = np.zeros((pieces, 5)), count / pieces, 0
    for piece in range(pieces):
        stop = count if piece == pieces - 1 else int((piece + 1) * step)
        for row in range(start, stop):
            way_m = rows[row, THETA] * ratio_m_per_rad
            found[piece, TIME] += rows[row, T]
            found[piece, PARTED] += way_m - rows[row, X]
            found[piece, WAY] += way_m
            found[piece, TORQUE] += rows[row, U]
        found[piece] /= stop - start
        gone_m = (rows[stop, THETA] - rows[start, THETA]) * ratio_m_per_rad
        found[piece, SPEED] = gone_m / (rows[stop, T] - rows[start, T])
        found[piece, PARTED] -= skew_s * found[piece, SPEED]
        start = stop
    return found


@compiled
def parted_m(pieces: Floats, push: Floats, anchors: Floats, limits: Floats, rough: Floats) -> float:
    """Take pieces up to the first at which the encoders part beyond a sound axis' limits, m, or 0.

    Args:
        pieces: (k, 5), as of `pieces_of`.
        push: (5,), changed in place.
        anchors: (4, 5), changed in place.
        limits: (6,).
        rough: (3,).
    """
    for piece in pieces:
        push[CLOSED] = _pushes(piece, push, limits, rough)
        if push[CLOSED] == 0.0:
            anchors[BEGUN], anchors[NEWEST] = np.nan, np.nan
        resting = abs(piece[SPEED]) <= RESTING_RAD_S * limits[RATIO]
        for name in range(4):
            if np.isnan(anchors[name, TIME]) or (name == REST and not resting):
                continue
            apart_m = abs(piece[PARTED] - anchors[name, PARTED])
            play_m = limits[PLAY] if name in (HELD, REST) else 0.0
            if apart_m > play_m + _allowed_m(anchors[name], piece, limits, rough):
                return float(apart_m)
        if np.isnan(anchors[HELD, TIME]):
            anchors[HELD] = piece
        if resting:
            anchors[REST] = piece
        if push[CLOSED] != 0.0:
            if np.isnan(anchors[BEGUN, TIME]):
                anchors[BEGUN] = piece
            anchors[NEWEST], anchors[HELD] = piece, piece
    return 0.0


@compiled
def _allowed_m(anchor: Floats, piece: Floats, limits: Floats, rough: Floats) -> float:
    """Most by which a sound axis parts its encoders between two pieces, without play, m."""
    growth = min(GROWTH_PER_LENGTH_S * (piece[TIME] - anchor[TIME]), MOST_GROWTH)
    return float(
        limits[PERIODIC]
        + 3.0 * rough[NOISE]
        + _stretch_m(piece[TORQUE] - anchor[TORQUE], limits, rough)
        + limits[LENGTH] * growth
        + SLOPE * abs(piece[WAY] - anchor[WAY])
        + (LAG_S + rough[LAG]) * abs(piece[SPEED] - anchor[SPEED])
    )


@compiled
def _stretch_m(torque_nm: float, limits: Floats, rough: Floats) -> float:
    """Greatest stretch with a change of torque, m; where none is known, as much as play."""
    span_nm = abs(torque_nm) if abs(torque_nm) > rough[SPAN] else rough[SPAN]
    return float(limits[PLAY] if np.isnan(span_nm) else limits[STRETCH] * span_nm)


@compiled
def _pushes(piece: Floats, contact: Floats, limits: Floats, rough: Floats) -> float:
    """Take the next piece of the motion; 1 once the nut pushed beyond play and stretch, else 0."""
    resting = abs(piece[SPEED]) <= RESTING_RAD_S * limits[RATIO]
    along = 0.0 if resting else (1.0 if piece[SPEED] > 0.0 else -1.0)
    gained_m_s = (piece[SPEED] - contact[PUSHED_SPEED]) * along
    most_m_s = BRAKING_RAD_S2 * limits[RATIO] * (piece[TIME] - contact[PUSHED_TIME])
    pushing = along != 0.0 and along == contact[DIRECTION] and piece[TORQUE] * along > 0.0
    pushing = pushing and gained_m_s >= -most_m_s
    contact[DIRECTION] = along
    contact[PUSHED_SPEED], contact[PUSHED_TIME] = piece[SPEED], piece[TIME]
    if not pushing:
        contact[PUSHED_FROM] = np.nan
        return 0.0
    if np.isnan(contact[PUSHED_FROM]):
        contact[PUSHED_FROM] = piece[WAY]
        return 0.0
    hidden_m = limits[PLAY] + _stretch_m(piece[TORQUE], limits, rough)
    return 1.0 if abs(piece[WAY] - contact[PUSHED_FROM]) >= hidden_m else 0.0
