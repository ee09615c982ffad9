"""Empirical shapes: forms of an effect on a real axis beyond its entry; they bear its name.

An entry of the library states an effect by a few numbers. A real screw does not warm up by an
exponential of time alone, and a cut is no rectangle: without these forms what an entry cannot
follow would be blamed on another effect.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.empirical import Covered, EmpiricalForm, MotionCurve
from ...models.effects.registry import effects
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .regressor import Ranges


@dataclass(frozen=True, slots=True)
class EmpiricalShape:
    """Columns of a form of an effect; in both channels their proportion is part of it."""

    name: str
    curves: EmpiricalForm

    @property
    def form(self) -> str:
        """Name of the form."""
        return self.curves.name

    @property
    def size(self) -> int:
        """Number of its columns."""
        return max(len(self.curves.torque), len(self.curves.transmission))

    def columns(self, session: Session, channel: str) -> Floats:
        """Columns in a channel, (n, size); zero in one that it does not show in."""
        curves = self.curves.torque if channel == TORQUE_GAP else self.curves.transmission
        if not curves:
            return np.zeros((len(session.channels[channel].gap), self.size))
        return np.column_stack(
            [session.column(channel, _on(curve, session.baseline)) for curve in curves]
        )


def _on(curve: MotionCurve, baseline: Baseline) -> Callable[[Motion], Floats]:
    return lambda motion: curve(motion, baseline)


def empirical_shapes(session: Session) -> Iterator[EmpiricalShape]:
    """Empirical shapes of the library that the recorded channels could show."""
    ranges = Ranges.of_session(session)
    covered = Covered(ranges.duration_s, ranges.low_m, ranges.span_m)
    for effect in effects().values():
        for form in effect.empirical_forms(covered, session.baseline):
            shown = {TORQUE_GAP: form.torque, TRANSMISSION_GAP: form.transmission}
            if {channel for channel in shown if shown[channel]} <= session.channels.keys():
                yield EmpiricalShape(effect.name, form)
