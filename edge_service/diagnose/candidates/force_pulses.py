"""Force pulses on the table, found where the torque has a mean of its own for a while."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Booleans, Floats
from ...models.effects.baseline import Motion
from ...models.effects.registry import disturbance, get_effect
from ..session.session import TORQUE_GAP, Session
from .regressors import EntryRegressor, entry_regressor

_DISTURBED_S = 0.2
_MOST_PULSES = 10
FORCE = disturbance()
"""Effect that no motion predicts: what the motion predicts is no force."""


@dataclass(frozen=True, slots=True)
class ForcePulse:
    """Constant force on the table within a span of time."""

    start_s: float
    end_s: float
    against_motion: bool

    name = FORCE
    size = 1

    @property
    def form(self) -> str:
        """Name of the form: `against` if the force turns with the motion, otherwise `steady`."""
        return "against" if self.against_motion else "steady"

    def columns(self, session: Session, channel: str) -> Floats:
        """Torque per N, (n, 1)."""
        if channel != TORQUE_GAP:
            return np.zeros((len(session.channels[channel].gap), 1))

        def torque_nm(motion: Motion) -> Floats:
            inside = (motion.time_s >= self.start_s) & (motion.time_s < self.end_s)
            way = motion.direction if self.against_motion else np.ones(len(motion))
            return np.where(inside, -session.baseline.ratio_m_per_rad * way, 0.0)

        return session.column(TORQUE_GAP, torque_nm)[:, None]

    def as_entry(self) -> EntryRegressor | None:
        """Force of a steady direction as its entry."""
        if self.against_motion:
            return None
        shape = {"start_s": max(self.start_s, 0.0), "duration_s": self.end_s - self.start_s}
        return entry_regressor(get_effect(FORCE), "force_n", shape)

    def covers(self, time_s: Floats) -> Booleans:
        """Mask of the times that it disturbs, with the controller's answer to its end, (n,)."""
        inside: Booleans = (time_s >= self.start_s - _DISTURBED_S) & (
            time_s < self.end_s + _DISTURBED_S
        )
        return inside


def force_pulses(session: Session, left: Floats) -> Iterator[ForcePulse]:
    """Spans of time in which what is left of the torque has a mean of its own, strongest first.

    Args:
        left: residual of the session's torque, N m, (n,).
    """
    rows = session.channels[TORQUE_GAP]
    order = np.argsort(rows.variables["time_s"], kind="stable")
    time_s, left = rows.variables["time_s"][order], left[order]
    direction = np.sign(rows.variables["direction"][order])
    cells = np.floor((time_s - time_s[0]) / 0.1).astype(int)
    count = np.bincount(cells).astype(float)
    remaining = {False: left.copy(), True: left * direction}
    for _ in range(_MOST_PULSES):
        spans = [
            (*_strongest_span(np.bincount(cells, values).astype(np.float64), count), against)
            for against, values in remaining.items()
        ]
        first, last, _, against = max(spans, key=lambda span: span[2])
        inside = (cells >= first) & (cells < last)
        if not inside.any():
            return
        yield ForcePulse(time_s[0] + 0.1 * first, time_s[0] + 0.1 * last, against)
        mean = float(remaining[against][inside].mean())
        taken = mean * (direction[inside] if against else 1.0)
        remaining[False][inside] -= taken
        remaining[True][inside] -= taken * direction[inside]


def _strongest_span(sums: Floats, count: Floats) -> tuple[int, int, float]:
    """Cells [i, j) of at most 20 s that hold the most energy in their mean."""
    total = np.concatenate(([0.0], np.cumsum(sums)))
    rows = np.concatenate(([0.0], np.cumsum(count)))
    best = (0, 0, 0.0)
    for length in np.unique(np.geomspace(3, 200, 30).astype(int)):
        if length >= len(total):
            break
        energy = (total[length:] - total[:-length]) ** 2
        energy /= np.maximum(rows[length:] - rows[:-length], 5.0)
        k = int(np.argmax(energy))
        if energy[k] > best[2]:
            best = (k, k + int(length), float(energy[k]))
    return best
