"""Forms that an effect takes on a real axis beyond those of its entry; they bear its name.

An entry of the library states an effect by a few numbers. A real screw does not warm up by an
exponential of time alone, and a cut is no rectangle: without these forms what an entry cannot
follow would be blamed on another effect.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from ..fingerprint.regression import Booleans
from ..messages.samples import Floats
from ..models.effects.baseline import Baseline, Motion
from ..models.effects.hysteresis import bristle_share, play
from .atoms import Ranges
from .session import TORQUE_GAP, TRANSMISSION_GAP, Session

Curve = Callable[[Motion, Baseline], Floats]
_PROFILE_ORDERS = (2, 3, 4, 5, 6)
_HEAT_CELLS = 40
_DISTURBED_S = 0.2
_TABLE_SHARES = (0.4, 0.8)
_RUBBED = (0.0, 1.0, 2.0, 2.8, 3.6, 4.8, 6.5)
"""Share of the dry friction behind a spring over the share of the inertia behind it."""
_STIRRED = (0.5, 1.0)
"""Share of the viscous friction behind a spring over that of the dry friction."""


@dataclass(frozen=True, slots=True)
class FreeForm:
    """Columns in one channel, as functions of the motion."""

    name: str
    form: str
    channel: str
    curves: tuple[Curve, ...]

    @property
    def size(self) -> int:
        """How many columns it has."""
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
class PairedForm:
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


def free_forms(session: Session) -> Iterator[FreeForm | PairedForm]:
    """Every free form that the recorded channels could show."""
    ranges = Ranges.of_session(session)
    if TORQUE_GAP in session.channels:
        yield from _torque_forms(ranges)
    if TRANSMISSION_GAP in session.channels:
        yield from _transmission_forms(ranges)
    if len(session.channels) > 1:
        yield from _paired_forms(session.baseline)


def _times(ranges: Ranges) -> Sequence[float]:
    return [share * ranges.duration_s for share in (0.1, 0.3, 1.0)]


def _torque_forms(ranges: Ranges) -> Iterator[FreeForm]:
    for tau in _times(ranges):
        yield FreeForm("warmup", "heat", TORQUE_GAP, (_eased_dry(tau),))
        yield FreeForm("warmup", "heat_viscous", TORQUE_GAP, (_eased_viscous(tau),))
    for power in (1.4, 1.6, 1.8, 2.4, 3.0):
        yield FreeForm("quadratic_friction", "power", TORQUE_GAP, (_churned(power),))
    for speed in np.geomspace(0.3, 30.0, 8):
        yield FreeForm("stribeck", "late", TORQUE_GAP, (_late_excess(float(speed)),))


def _transmission_forms(ranges: Ranges) -> Iterator[FreeForm]:
    for tau in _times(ranges):
        yield FreeForm("thermal_growth", "heat", TRANSMISSION_GAP, (_grown(tau),))
        yield FreeForm("thermal_growth", "end", TRANSMISSION_GAP, (_pushed(tau),))
        yield FreeForm("thermal_growth", "local", TRANSMISSION_GAP, (_local(tau),))
    profile = [_profile(ranges.low_m, ranges.span_m, order) for order in _PROFILE_ORDERS]
    yield FreeForm("lead_error", "profile", TRANSMISSION_GAP, tuple(profile))
    for dry in _RUBBED:
        for viscous in _STIRRED if dry else _STIRRED[:1]:
            wound = _wound(dry, viscous * dry)
            yield FreeForm("compliance", "loads", TRANSMISSION_GAP, wound)


def _paired_forms(baseline: Baseline) -> Iterator[PairedForm]:
    for share in _TABLE_SHARES:
        for width in np.geomspace(2e-6, 6e-5, 9):
            late = _late_friction(float(width), share)
            yield PairedForm("backlash", "late", late, _flank(float(width)))
        for compliance in np.geomspace(3e-9, 3e-7, 9):
            reach = 2.0 * float(compliance) * share * baseline.coulomb_nm
            late = _late_friction(reach / baseline.ratio_m_per_rad, share)
            yield PairedForm("compliance", "late", late, _yielding(float(compliance), share))


def _churned(power: float) -> Curve:
    return lambda motion, _: motion.direction * np.power(np.abs(motion.speed_rad_s) / 100.0, power)


def _late_excess(speed_rad_s: float) -> Curve:
    """Breakaway that builds up over the first micrometre, as bristles let it."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        held = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, 1e-6)
        risen: Floats = held * np.exp(-np.abs(motion.speed_rad_s) / speed_rad_s)
        return risen

    return curve


def _late_friction(reach_m: float, share: float) -> Curve:
    """The table's friction comes late where the motor has to turn before the table moves."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        held = bristle_share(baseline.ratio_m_per_rad * motion.angle_rad, reach_m)
        return share * baseline.coulomb_nm * (held - motion.direction)

    return curve


def _yielding(compliance_m_per_n: float, share: float) -> Curve:
    def curve(motion: Motion, baseline: Baseline) -> Floats:
        load = baseline.table_inertia_kg_m2 * motion.acceleration_rad_s2
        rubbed = baseline.coulomb_nm * motion.approach
        rubbed = rubbed + baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        load = load + share * rubbed
        return -compliance_m_per_n * load / baseline.ratio_m_per_rad

    return curve


def heat(motion: Motion, time_constant_s: float) -> Floats:
    """First-order warmth of an axis that its own motion heats, 1 at the mean when warm, (n,)."""
    speed = np.abs(motion.speed_rad_s)
    period_s = float(motion.time_s[1] - motion.time_s[0])
    keep = float(np.exp(-period_s / time_constant_s))
    mean = max(float(speed.mean()), 1e-9)
    return np.asarray(signal.lfilter([(1.0 - keep) / mean], [1.0, -keep], speed))


def _eased_dry(tau_s: float) -> Curve:
    return lambda motion, _: motion.direction * np.exp(-2.0 * heat(motion, tau_s))


def _eased_viscous(tau_s: float) -> Curve:
    return lambda motion, _: motion.speed_rad_s * np.exp(-2.0 * heat(motion, tau_s))


def _grown(tau_s: float) -> Curve:
    return lambda motion, _: motion.position_m * heat(motion, tau_s)


def _pushed(tau_s: float) -> Curve:
    """Growth of what lies between the fixed bearing and the nearest place of the nut."""
    return lambda motion, _: heat(motion, tau_s)


def _wound(dry: float, viscous: float) -> tuple[Curve, Curve]:
    """Wind-up by a compliance that is even, and by one that grows with the position.

    The spring carries a share of the inertia and so many times as great a share of the frictions:
    no load is friction alone.
    """

    def load(motion: Motion, baseline: Baseline) -> Floats:
        rubbed = dry * baseline.coulomb_nm * motion.approach
        rubbed = rubbed + viscous * baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        return -baseline.inertia_kg_m2 * motion.acceleration_rad_s2 - rubbed

    return load, lambda motion, baseline: motion.position_m * load(motion, baseline)


def _local(tau_s: float) -> Curve:
    """Growth of a screw that is heated where the nut runs, without conduction."""

    def curve(motion: Motion, _baseline: Baseline) -> Floats:
        low, high = float(motion.position_m.min()), float(motion.position_m.max())
        width = max(high - low, 1e-6) / _HEAT_CELLS
        step = max(round(0.05 / float(motion.time_s[1] - motion.time_s[0])), 1)
        position, speed = motion.position_m[::step], np.abs(motion.speed_rad_s[::step])
        cell = np.clip(((position - low) / width).astype(int), 0, _HEAT_CELLS - 1)
        keep = float(np.exp(-step * float(motion.time_s[1] - motion.time_s[0]) / tau_s))
        gained = np.zeros((len(cell), _HEAT_CELLS))
        gained[np.arange(len(cell)), cell] = speed * (1.0 - keep)
        warm = signal.lfilter([1.0], [1.0, -keep], gained, axis=0)
        below = np.cumsum(warm, axis=1) - 0.5 * warm
        grown = below[np.arange(len(cell)), cell] * width
        scale = max(float(np.abs(grown).max()), 1e-30)
        reached: Floats = grown / scale * max(high, 1e-3)
        spread: Floats = np.interp(motion.time_s, motion.time_s[::step], reached)
        return spread

    return curve


def _profile(low_m: float, span_m: float, order: int) -> Curve:
    return lambda motion, _: np.cos(order * np.pi * (motion.position_m - low_m) / span_m)


def _flank(width_m: float) -> Curve:
    """Play whose flank is that of the load: a table that brakes leans on the other flank."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        travel = baseline.ratio_m_per_rad * motion.angle_rad
        load = baseline.table_inertia_kg_m2 * motion.acceleration_rad_s2
        load = load + 0.5 * baseline.coulomb_nm * motion.approach
        leaned = np.where(load * motion.approach < 0.0, -motion.approach * width_m, 0.0)
        return play(travel, width_m) - travel - leaned

    return curve


@dataclass(frozen=True, slots=True)
class Push:
    """A force on the table within a span of time."""

    start_s: float
    end_s: float
    against_motion: bool

    name = "external_force"
    size = 1

    @property
    def form(self) -> str:
        """Whether it turns with the motion."""
        return "against" if self.against_motion else "steady"

    def columns(self, session: Session, channel: str) -> Floats:
        """Torque per N, (n, 1)."""
        if channel != TORQUE_GAP:
            return np.zeros((len(session.channels[channel].gap), 1))
        return session.torque_column(lambda motion: self._torque(motion, session.baseline))[:, None]

    def covers(self, time_s: Floats) -> Booleans:
        """Times that it disturbs, with the controller's answer to its end, (n,)."""
        inside: Booleans = (time_s >= self.start_s - _DISTURBED_S) & (
            time_s < self.end_s + _DISTURBED_S
        )
        return inside

    def _torque(self, motion: Motion, baseline: Baseline) -> Floats:
        inside = (motion.time_s >= self.start_s) & (motion.time_s < self.end_s)
        way = motion.direction if self.against_motion else np.ones(len(motion))
        return np.where(inside, -baseline.ratio_m_per_rad * way, 0.0)


def pushes(time_s: Floats, direction: Floats, left: Floats, most: int = 10) -> Iterator[Push]:
    """Spans of time in which what is left of the torque has a mean of its own, strongest first.

    Args:
        time_s, direction, left: of the rows of one unbroken clock, (n,).
    """
    cells = np.floor((time_s - time_s[0]) / 0.1).astype(int)
    count = np.bincount(cells).astype(float)
    remaining = {False: left.copy(), True: left * direction}
    for _ in range(most):
        spans = [
            (*_strongest_span(np.bincount(cells, values).astype(np.float64), count), against)
            for against, values in remaining.items()
        ]
        first, last, _, against = max(spans, key=lambda span: span[2])
        inside = (cells >= first) & (cells < last)
        if not inside.any():
            return
        yield Push(time_s[0] + 0.1 * first, time_s[0] + 0.1 * last, against)
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


def lone_forms(session: Session, left: Floats) -> Sequence[Push]:
    """Pushes of a session, for what is left of its torque."""
    rows = session.channels[TORQUE_GAP]
    order = np.argsort(rows.variables["time_s"], kind="stable")
    return list(
        pushes(
            rows.variables["time_s"][order],
            np.sign(rows.variables["direction"][order]),
            left[order],
        )
    )
