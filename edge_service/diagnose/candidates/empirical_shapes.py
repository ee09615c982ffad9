"""Forms that an effect takes on a real axis beyond those of its entry; they bear its name.

An entry of the library states an effect by a few numbers. A real screw does not warm up by an
exponential of time alone, and a cut is no rectangle: without these forms what an entry cannot
follow would be blamed on another effect.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.empirical import Covered, MotionCurve
from ...models.effects.registry import effects
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .regressor import Ranges


@dataclass(frozen=True, slots=True)
class EmpiricalShape:
    """Columns in one channel, as functions of the motion."""

    name: str
    form: str
    channel: str
    curves: tuple[MotionCurve, ...]

    @property
    def size(self) -> int:
        """Number of its columns."""
        return len(self.curves)

    def columns(self, session: Session, channel: str) -> Floats:
        """Its columns in a channel, (n, size); zero in the other one."""
        if channel != self.channel:
            return np.zeros((len(session.channels[channel].gap), self.size))
        place = session.torque_column if channel == TORQUE_GAP else session.transmission_column
        return np.column_stack([place(_on(curve, session.baseline)) for curve in self.curves])


def _on(curve: MotionCurve, baseline: Baseline) -> Callable[[Motion], Floats]:
    return lambda motion: curve(motion, baseline)


@dataclass(frozen=True, slots=True)
class PairedShape:
    """One column in both channels, whose proportion is part of what it claims."""

    name: str
    form: str
    torque: MotionCurve
    transmission: MotionCurve

    @property
    def size(self) -> int:
        """One."""
        return 1

    def columns(self, session: Session, channel: str) -> Floats:
        """Its column in a channel, (n, 1)."""
        curve = self.torque if channel == TORQUE_GAP else self.transmission
        place = session.torque_column if channel == TORQUE_GAP else session.transmission_column
        return place(lambda motion: curve(motion, session.baseline))[:, None]


def empirical_shapes(session: Session) -> Iterator[EmpiricalShape | PairedShape]:
    """Every empirical shape that the recorded channels could show: of one channel, then of both."""
    ranges = Ranges.of_session(session)
    covered = Covered(ranges.duration_s, ranges.low_m, ranges.span_m)
    forms = [
        (effect.name, form)
        for effect in effects().values()
        for form in effect.empirical_forms(covered, session.baseline)
    ]
    for name, form in forms:
        if TORQUE_GAP in session.channels and not form.transmission:
            yield EmpiricalShape(name, form.name, TORQUE_GAP, form.torque)
    for name, form in forms:
        if TRANSMISSION_GAP in session.channels and not form.torque:
            yield EmpiricalShape(name, form.name, TRANSMISSION_GAP, form.transmission)
    for name, form in forms:
        if len(session.channels) > 1 and form.torque and form.transmission:
            yield PairedShape(name, form.name, form.torque[0], form.transmission[0])
