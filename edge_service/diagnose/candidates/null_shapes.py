"""Null shapes: the plainest that a gap can take, without a name; rivals of every entry.

A cause that the library lacks is taken for its nearest relation, unless something plainer that
claims less explains the gap as well: a level, a slope, a wave in one channel alone.
"""

from collections.abc import Callable, Iterator

import numpy as np

from ...messages.samples import Floats
from ...models.effects.baseline import Motion
from ...models.effects.empirical import EmpiricalForm, MotionCurve
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .empirical_shapes import EmpiricalShape

UNKNOWN = "unknown"
_WAVES = range(1, 5)

_TORQUES: tuple[Callable[[Motion], Floats], ...] = (
    lambda motion: motion.direction,
    lambda motion: motion.speed_rad_s,
    lambda motion: motion.acceleration_rad_s2,
    lambda motion: np.ones(len(motion)),
    lambda motion: motion.model_torque_nm,
)


def null_shapes(session: Session) -> Iterator[EmpiricalShape]:
    """Null shapes that the recorded channels could show."""
    if TORQUE_GAP in session.channels:
        for torque in _TORQUES:
            yield EmpiricalShape(UNKNOWN, EmpiricalForm("level", (_plain(torque),)))
    if TRANSMISSION_GAP in session.channels:
        slope = (_plain(lambda motion: motion.position_m),)
        yield EmpiricalShape(UNKNOWN, EmpiricalForm("slope", transmission=slope))
        for order in _WAVES:
            waves = _wave(order, 0.0), _wave(order, 0.5 * np.pi)
            yield EmpiricalShape(UNKNOWN, EmpiricalForm("wave", transmission=waves))


def _plain(curve: Callable[[Motion], Floats]) -> MotionCurve:
    return lambda motion, _baseline: curve(motion)


def _wave(order: int, phase_rad: float) -> MotionCurve:
    return lambda motion, _baseline: np.sin(order * motion.angle_rad + phase_rad)
