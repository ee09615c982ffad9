"""Forms that an effect takes on a real axis beyond those of its entry; they bear its name.

An entry of the library states an effect by a few numbers. A real screw does not warm up by an
exponential of time alone, and a cut is no rectangle: without these forms what an entry cannot
follow would be blamed on another effect.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.baseline import Baseline, Motion
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session
from .regressor import Ranges
from .shape_curves import (
    Curve,
    bearing_growth,
    delayed_friction,
    load_side_play,
    load_windup,
    local_growth,
    power_law_friction,
    presliding_stribeck,
    thermal_growth,
    travel_wave,
    warmup_coulomb,
    warmup_viscous,
    windup_by_loads,
)

__all__ = ["Curve", "EmpiricalShape", "PairedShape", "empirical_shapes"]

_PROFILE_ORDERS = (2, 3, 4, 5, 6)
_TABLE_SHARES = (0.4, 0.8)
_COULOMB_SHARES = (0.0, 1.0, 2.0, 2.8, 3.6, 4.8, 6.5)
"""Share of the Coulomb friction behind a spring over the share of the inertia behind it."""
_VISCOUS_SHARES = (0.5, 1.0)
"""Share of the viscous friction behind a spring over that of the Coulomb friction."""


@dataclass(frozen=True, slots=True)
class EmpiricalShape:
    """Columns in one channel, as functions of the motion."""

    name: str
    form: str
    channel: str
    curves: tuple[Curve, ...]

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


def _on(curve: Curve, baseline: Baseline) -> Callable[[Motion], Floats]:
    return lambda motion: curve(motion, baseline)


@dataclass(frozen=True, slots=True)
class PairedShape:
    """One column in both channels, whose proportion is part of what it claims."""

    name: str
    form: str
    torque: Curve
    transmission: Curve

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
    """Every empirical shape that the recorded channels could show."""
    ranges = Ranges.of_session(session)
    if TORQUE_GAP in session.channels:
        yield from _torque_shapes(ranges)
    if TRANSMISSION_GAP in session.channels:
        yield from _transmission_shapes(ranges)
    if len(session.channels) > 1:
        yield from _paired_shapes(session.baseline)


def _times(ranges: Ranges) -> Sequence[float]:
    return [share * ranges.duration_s for share in (0.1, 0.3, 1.0)]


def _torque_shapes(ranges: Ranges) -> Iterator[EmpiricalShape]:
    for tau in _times(ranges):
        yield EmpiricalShape("warmup", "heat", TORQUE_GAP, (warmup_coulomb(tau),))
        yield EmpiricalShape("warmup", "heat_viscous", TORQUE_GAP, (warmup_viscous(tau),))
    for power in (1.4, 1.6, 1.8, 2.4, 3.0):
        yield EmpiricalShape(
            "quadratic_friction", "power", TORQUE_GAP, (power_law_friction(power),)
        )
    for speed in np.geomspace(0.3, 30.0, 8):
        yield EmpiricalShape("stribeck", "late", TORQUE_GAP, (presliding_stribeck(float(speed)),))


def _transmission_shapes(ranges: Ranges) -> Iterator[EmpiricalShape]:
    for tau in _times(ranges):
        yield EmpiricalShape("thermal_growth", "heat", TRANSMISSION_GAP, (thermal_growth(tau),))
        yield EmpiricalShape("thermal_growth", "end", TRANSMISSION_GAP, (bearing_growth(tau),))
        yield EmpiricalShape("thermal_growth", "local", TRANSMISSION_GAP, (local_growth(tau),))
    profile = [travel_wave(ranges.low_m, ranges.span_m, order) for order in _PROFILE_ORDERS]
    yield EmpiricalShape("lead_error", "profile", TRANSMISSION_GAP, tuple(profile))
    for coulomb in _COULOMB_SHARES:
        for viscous in _VISCOUS_SHARES if coulomb else _VISCOUS_SHARES[:1]:
            curves = windup_by_loads(coulomb, viscous * coulomb)
            yield EmpiricalShape("compliance", "loads", TRANSMISSION_GAP, curves)


def _paired_shapes(baseline: Baseline) -> Iterator[PairedShape]:
    for share in _TABLE_SHARES:
        for width in np.geomspace(2e-6, 6e-5, 9):
            late = delayed_friction(float(width), share)
            yield PairedShape("backlash", "late", late, load_side_play(float(width)))
        for compliance in np.geomspace(3e-9, 3e-7, 9):
            reach = 2.0 * float(compliance) * share * baseline.coulomb_nm
            late = delayed_friction(reach / baseline.ratio_m_per_rad, share)
            yield PairedShape("compliance", "late", late, load_windup(float(compliance), share))
