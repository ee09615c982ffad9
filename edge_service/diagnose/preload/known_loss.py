"""Loss of preload that the estimator is sure of, and how the torque says that it went."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import ActiveEffect
from ...models.effects.registry import fault
from ..estimation.estimates import Interval
from ..session.session import TORQUE_GAP, Session

SURELY_LOST_PERCENT = 10.0
"""Loss that the whole interval of the estimator must exceed (assumption): less is no fault yet."""
_ENDS = 12
_LEAST_GAIN = 0.9
"""Of what an even loss leaves: a fall within the recording must leave less to be one."""


@dataclass(frozen=True, slots=True)
class PreloadReading:
    """Preload that the estimator reads in the recordings, in percent of fresh (95 %).

    Attributes:
        two_encoders: the stretch was a witness, beside the torque.
    """

    value: float
    low: float
    high: float
    two_encoders: bool

    @property
    def lost(self) -> Interval:
        """Loss in percent of fresh."""
        value, low, high = (
            min(max(100.0 - each, 0.0), 100.0) for each in (self.value, self.high, self.low)
        )
        return Interval(value, low, high, "%")

    @property
    def is_lost(self) -> bool:
        """True if preload is lost beyond doubt; friction alone never is."""
        return self.two_encoders and self.lost.low > SURELY_LOST_PERCENT

    @property
    def is_there(self) -> bool:
        """True if none that matters is lost, beyond doubt."""
        return self.two_encoders and self.lost.high < SURELY_LOST_PERCENT


def known_loss(session: Session, fresh: Mapping[str, float]) -> ActiveEffect:
    """Loss of preload whose end and course fit the torque best: lost before, or at an even rate."""
    effect = fault()
    rows = session.channels[TORQUE_GAP]
    way = session.torque_column(lambda motion: motion.direction)
    time_s = rows.variables["time_s"]
    beside = np.column_stack(
        [session.torque_column(lambda m: m.speed_rad_s), np.ones(len(way)), rows.variables[_PUSH]]
    )
    drag = fresh["fresh_drag_nm"] / 100.0
    level, even = _fitted(np.column_stack([-drag * way, beside]), rows.gap)
    best, values = _LEAST_GAIN * even, {"lost_percent": float(level[0])}
    for end_s in np.linspace(float(time_s.min()), float(time_s.max()), _ENDS + 1)[1:]:
        falling = drag * way * np.maximum(end_s - time_s, 0.0)
        found, left = _fitted(np.column_stack([-drag * way, falling, beside]), rows.gap)
        if left < best and found[1] > 0.0:
            best = left
            values = {"lost_percent": found[0], "percent_per_s": found[1], "until_s": end_s}
    values["lost_percent"] = float(np.clip(values["lost_percent"], 0.0, 100.0))
    known = {name: float(each) for name, each in values.items()}
    return ActiveEffect(effect, effect.complete({**known, **fresh}))


_PUSH = "motor_acceleration_rad_s2"


def _fitted(columns: Floats, gap: Floats) -> tuple[Floats, float]:
    """Coefficients of columns (n, p), and the mean square that they leave."""
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    beta = np.linalg.lstsq(columns / scale, gap, rcond=None)[0]
    return beta / scale, float(np.mean((gap - columns / scale @ beta) ** 2))
