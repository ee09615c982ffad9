"""Candidate regressors: what may explain a gap, each linear in its strength.

Entries of the library over a grid of their shapes come with empirical shapes of the same name, for
a real screw does not warm up by an exponential of time alone. Null shapes bear no name and are the
rivals of all: a cause that the library lacks is taken for its nearest relation, unless something
plainer explains the gap as well.
"""

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import TORQUE, Floats
from ...models.effects.baseline import Motion
from ...models.effects.effect import Effect, Kind, Parameter, Role, Term
from ...models.effects.empirical import Covered, EmpiricalForm, MotionCurve, heat
from ...models.effects.registry import disturbance, effects, effects_where, error_of, get_effect
from ...regression.run import is_below
from ..residual.vibration import hidden_vibration
from ..result import VIBRATION
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session

UNKNOWN = "unknown"
FORCE = disturbance()
"""Effect that no motion predicts: what the motion predicts is no force."""
_OFTEN = 0.75
_NOISE_SIGMAS = 5.0
_LEAST_LEADS, _MOST_WAVES = 2.0, 40
"""Waves along the travel: half ones of it, a whole one, and so on; of a turn there are orders."""
_LEAST_WARMING_K = 0.5
"""A housing that warms up by less says nothing of what follows its temperature."""
_WARMING_S = 20.0
"""Nothing on an axis warms up faster; a drift within a shorter recording is not its heat."""
_NULL_WAVES = range(1, 5)
STEADY = min(effects_where(lambda effect: effect.kind is Kind.LOAD and effect.term is None))
_NULL_TORQUES: dict[str, tuple[MotionCurve, ...]] = {  # each beside no entry of the same column
    error_of(Term.COULOMB): (lambda motion, _: motion.direction,),
    error_of(Term.VISCOUS): (lambda motion, _: motion.speed_rad_s,),
    error_of(Term.INERTIA): (lambda motion, _: motion.acceleration_rad_s2,),
    STEADY: (lambda motion, _: np.ones(len(motion)),),
    error_of(Term.GAIN): (lambda motion, _: motion.model_torque_nm,),
    UNKNOWN: (  # friction that grows with what speeds the axis up, or slows it down, or both
        lambda motion, _: motion.acceleration_rad_s2,
        lambda motion, _: motion.direction * np.abs(motion.acceleration_rad_s2),
    ),
}
_WEAK_AFTER_S = (3.0, 30.0)
"""Times in which a motor's own torque heats what weakens it."""
_BETWEEN = {Kind.LOST_MOTION, Kind.TRAVEL, Kind.MEASUREMENT}
"""Kinds of effects that two encoders show; the torque shows the others."""


@dataclass(frozen=True, slots=True)
class EntryRegressor:
    """Entry of the library at one shape."""

    effect: Effect
    form: str  # name of the amount; empty where the effect has none, and its shape is its strength
    shape: tuple[tuple[str, float], ...]  # the values of its shapes
    # complete values of each column: at unit amount, for a harmonic at phases 0 and pi/2
    at: tuple[Mapping[str, float], ...]

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def size(self) -> int:
        """Number of its columns: one, or two for a harmonic."""
        return len(self.at)

    def columns(self, session: Session, channel: str) -> Floats:
        """Signatures at unit strength in a channel, (n, size)."""
        return np.column_stack(
            [session.signature(channel, self.effect, values) for values in self.at]
        )

    @property
    def bound(self) -> Parameter | None:
        """Amount as the library bounds it; None where the effect has none."""
        return next((p for p in self.effect.parameters if p.name == self.form), None)

    def with_shape(self, **shape: float) -> "EntryRegressor":
        """Regressor of the same amount with other values of some shapes."""
        return entry_regressor(self.effect, self.form, dict(self.shape) | shape)

    def values(self, coefficients: Sequence[float] | Floats) -> dict[str, float]:
        """Values of the effect for the coefficients of the columns."""
        values = dict(self.at[0])
        if self.form and self.size == 2:
            cosine, sine = coefficients
            values[_phase_of(self.effect, self.form)] = math.atan2(sine, cosine)
            values[self.form] = math.hypot(cosine, sine)
        elif self.form:
            values[self.form] = float(coefficients[0])
        return values


def entry_regressor(effect: Effect, amount: str, shape: Mapping[str, float]) -> EntryRegressor:
    """Regressor of an amount at a shape."""
    values: dict[str, float] = {}
    for parameter in effect.parameters:
        if parameter.role is Role.SHAPE:
            values[parameter.name] = shape.get(parameter.name, parameter.faulty)
        else:
            values[parameter.name] = 1.0 if parameter.name == amount else 0.0
    phase = _phase_of(effect, amount)
    at = (values, values | {phase: 0.5 * np.pi}) if phase else (values,)
    return EntryRegressor(effect, amount, tuple(sorted(shape.items())), at)


def _phase_of(effect: Effect, amount: str) -> str:
    return next((p.name for p in _belonging(effect, amount) if p.role is Role.PHASE), "")


def _belonging(effect: Effect, amount: str) -> list[Parameter]:
    amounts = {p.name for p in effect.parameters if p.role is Role.AMOUNT}
    narrowed = {name for p in effect.parameters for name in p.amounts}
    return [
        p
        for p in effect.parameters
        if amount in p.amounts or (not p.amounts and (amount not in amounts or not narrowed))
    ]


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

        def column(curve: MotionCurve) -> Floats:
            return session.column(channel, lambda motion: curve(motion, session.baseline))

        return np.column_stack([column(curve) for curve in curves])


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


CandidateRegressor = EntryRegressor | EmpiricalShape | ForcePulse
"""An effect at one shape, whose strength is linear; of one name and form, shapes alone differ."""


def most_shapes(name: str) -> int:
    """Regressors of one effect that a set may hold; of what has no name, a few."""
    effect = effects().get(name)
    return 4 if effect is None else effect.most_shapes


def candidates_of(session: Session, library: Sequence[Effect]) -> list[CandidateRegressor]:
    """Regressors that bear the names of some effects, as far as a session could show them."""
    ranges, found = Ranges.of_session(session), list[CandidateRegressor]()
    shown = [effect for effect in library if effect.name not in hidden(session)]
    for effect in shown:
        found += regressors_of(effect, ranges)
    names = {effect.name for effect in shown}
    return found + [each for each in empirical_shapes(session, ranges) if each.name in names]


def hidden(session: Session) -> dict[str, str]:
    """Effects that no motion shows in what was recorded, by name, and why."""
    period_s, found = max(run.low_pass.period_s for run in session.runs), {}
    for name, effect in effects().items():
        if effect.is_fault:
            continue
        if is_below(period_s, effect.least_rate_hz):
            rates = f"at {1.0 / period_s:.3g} Hz, expected {effect.least_rate_hz:g} Hz"
            found[name] = f"sampled too slowly: {rates}"
        elif effect.kind in _BETWEEN and TRANSMISSION_GAP not in session.channels:
            found[name] = "one encoder only: what happens between motor and table cannot be seen"
    return found


def empirical_shapes(session: Session, ranges: "Ranges") -> Iterator[EmpiricalShape]:
    """Empirical shapes of the library that the recorded channels could show."""
    covered = Covered(ranges.duration_s, ranges.low_m, ranges.span_m)
    for effect in effects().values():
        for form in effect.empirical_forms(covered, session.baseline):
            shown = {TORQUE_GAP: form.torque, TRANSMISSION_GAP: form.transmission}
            if {channel for channel in shown if shown[channel]} <= session.channels.keys():
                yield EmpiricalShape(effect.name, form)


def null_shapes(session: Session, names: Collection[str]) -> Iterator[EmpiricalShape]:
    """Null shapes beside some entries: levels, slopes, waves, each in one recorded channel."""

    def wave(order: int, phase_rad: float) -> MotionCurve:
        return lambda motion, _baseline: np.sin(order * motion.angle_rad + phase_rad)

    if TORQUE_GAP in session.channels:
        for curves in (curves for name, curves in _NULL_TORQUES.items() if name not in names):
            yield EmpiricalShape(UNKNOWN, EmpiricalForm("level", curves))
        for tau_s in _WEAK_AFTER_S:
            yield EmpiricalShape(UNKNOWN, EmpiricalForm("weak", (_weakening(tau_s),)))
    if TRANSMISSION_GAP in session.channels:
        slope = EmpiricalForm("slope", transmission=(lambda motion, _: motion.position_m,))
        yield EmpiricalShape(UNKNOWN, slope)
        for order in _NULL_WAVES:
            waves = wave(order, 0.0), wave(order, 0.5 * np.pi)
            yield EmpiricalShape(UNKNOWN, EmpiricalForm("wave", transmission=waves))


def _weakening(tau_s: float) -> MotionCurve:
    """Torque that a motor lacks by the heat of what it gave."""
    return lambda m, _: m.model_torque_nm * heat(m, tau_s, m.model_torque_nm**2)


def regressors_of(effect: Effect, ranges: "Ranges") -> Iterator[EntryRegressor]:
    """Regressors of one entry that a recording of some ranges could show."""
    amounts = [p.name for p in effect.parameters if p.role is Role.AMOUNT] or [""]
    for amount in amounts:
        mine = [p for p in _belonging(effect, amount) if p.role is Role.SHAPE]
        grids = [[(p.name, value) for value in grid(p, ranges, amount)] for p in mine]
        for shape in itertools.product(*grids):
            yield entry_regressor(effect, amount, dict(shape))


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges that a recording covers."""

    fastest_rad_s: float
    duration_s: float
    low_m: float
    high_m: float
    strongest_nm: float  # greatest torque, less what noise may add to it
    often_nm: float  # torque that is exceeded in a quarter of the motion
    coldest_c: float  # of the housing; NaN where no temperature was recorded
    warmest_c: float  # the same
    lead_m: float
    coulomb_nm: float  # of the model
    table_coulomb_nm: float  # of it what acts on the table

    @property
    def span_m(self) -> float:
        """Travel, never 0."""
        return max(self.high_m - self.low_m, 1e-3)

    @classmethod
    def of_session(cls, session: Session) -> "Ranges":
        """Ranges over all runs."""
        time_s, position_m, speed_rad_s, temperature_c, torque_nm = (
            np.concatenate([getattr(run.motion, name) for run in session.runs])
            for name in ("time_s", "position_m", "speed_rad_s", "temperature_c", "torque_nm")
        )
        known_c = temperature_c[np.isfinite(temperature_c)]
        moving = np.concatenate([run.moving for run in session.runs])
        moved_nm = np.abs(torque_nm[moving & np.isfinite(torque_nm)])
        strongest_nm = max(
            float(np.nan_to_num(np.abs(run.motion.torque_nm)).max())
            - _NOISE_SIGMAS * run.noise.get(TORQUE, 0.0)
            for run in session.runs
        )
        return cls(
            fastest_rad_s=float(np.abs(speed_rad_s).max()),
            duration_s=float(np.ptp(time_s)),
            low_m=float(position_m.min()),
            high_m=float(position_m.max()),
            strongest_nm=strongest_nm,
            often_nm=float(np.quantile(moved_nm, _OFTEN)) if len(moved_nm) else 0.0,
            coldest_c=float(known_c.min()) if len(known_c) else math.nan,
            warmest_c=float(known_c.max()) if len(known_c) else math.nan,
            lead_m=2.0 * math.pi * session.baseline.ratio_m_per_rad,
            coulomb_nm=session.baseline.coulomb_nm,
            table_coulomb_nm=session.baseline.table_coulomb_nm,
        )


def grid(parameter: Parameter, ranges: Ranges, amount: str = "") -> Sequence[float]:
    """Values of a shape worth trying: stated, or by its unit and by what the recording covers."""
    match parameter.unit:
        case _ if parameter.name == "friction_share" and not ranges.table_coulomb_nm:
            values = np.array(parameter.tried)[[0, -1]]  # none or any: of no friction all are alike
        case _ if parameter.tried:
            values = np.array(parameter.tried)
        case _ if parameter.tried_of_travel:
            values = ranges.span_m * np.array(parameter.tried_of_travel)
        case "rad/s":
            values = np.geomspace(0.3, max(0.25 * ranges.fastest_rad_s, 3.0), 8)
        case "s":
            values = np.geomspace(0.05, 2.0, 6) * max(ranges.duration_s, _WARMING_S)
            # what the model has of dry friction may be that of an axis that is warm, or cold
            slow = [parameter.faulty] * (ranges.coulomb_nm > 0.0 and amount.endswith("_nm"))
            values = np.unique(np.maximum([*values, *slow], _WARMING_S))
        case "degC":
            warms = ranges.warmest_c - ranges.coldest_c >= _LEAST_WARMING_K
            values = np.linspace(ranges.coldest_c, ranges.warmest_c, 5) if warms else np.empty(0)
        case "m" if parameter.name == "wavelength_m":
            most = math.ceil(2.0 * ranges.span_m / (_LEAST_LEADS * ranges.lead_m))
            values = 2.0 * ranges.span_m / np.arange(1.0, min(most, _MOST_WAVES) + 1.0)
        case "m" if parameter.name.startswith("centre"):
            values = np.linspace(ranges.low_m, ranges.high_m, 25)
        case "m":
            values = np.geomspace(1e-6, 2e-4, 12)  # of what gives and sticks
        case "N m":
            low, high = ranges.often_nm, 0.99 * ranges.strongest_nm
            values = np.geomspace(low, high, 16) if 0.0 < low < high else np.empty(0)
        case _:
            values = parameter.faulty * np.geomspace(0.1, 10.0, 6)
    return [float(v) for v in values if parameter.low <= v <= parameter.high]


def unobservable(session: Session) -> dict[str, str]:
    """Effects that the recording could not show, by name, and why."""
    ranges, found = Ranges.of_session(session), hidden(session)
    free = {form.name for form in empirical_shapes(session, ranges)}
    for name, effect in effects().items():
        is_open = not (effect.is_fault or name in found or name in free)
        tried = list(regressors_of(effect, ranges)) if is_open else []
        shown = (
            bool(np.any(regressor.columns(session, channel)))
            for regressor in tried[:1] + tried[-1:]
            for channel in session.channels
        )
        if is_open and not any(shown):
            lacks_torque = effect.kind not in _BETWEEN and TORQUE_GAP not in session.channels
            found[name] = "no torque recorded" if lacks_torque else "not visible in this motion"
    why = {name: hidden_vibration(rows) for name, rows in session.channels.items()}
    unseen = [f"{name}: {words}" for name, words in why.items() if words]
    return found | {VIBRATION: "; ".join(unseen)} if unseen else found
