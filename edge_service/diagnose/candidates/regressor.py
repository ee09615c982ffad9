"""Candidate regressors: every entry of the library over a grid of its shapes, linear in amounts."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...messages.channels import TORQUE
from ...messages.samples import Floats
from ...models.effects.effect import Effect, Parameter, Role
from ..session.run import Run
from ..session.session import Session

_OFTEN = 0.75
_NOISE_SIGMAS = 5.0
_LEAST_LEADS, _MOST_WAVES = 2.0, 40
"""Waves along the travel: half ones of it, a whole one, and so on; of a turn there are orders."""
_SPANS_K = (8.0, 16.0, 40.0)
"""A lubricant falls to 1/e of its viscosity within these."""
_LEAST_WARMING_K = 0.5
"""A housing that warms up by less says nothing of what follows its temperature."""
_WARMING_S = 20.0
"""Nothing on an axis warms up faster; a drift within a shorter recording is not its heat."""


class CandidateRegressor(Protocol):
    """Candidate: an effect at one shape, whose strength is linear."""

    @property
    def name(self) -> str:
        """Name of the effect."""

    @property
    def form(self) -> str:
        """Label of a family: regressors of one name and form differ by their shapes alone."""

    @property
    def size(self) -> int:
        """Number of its columns."""

    def columns(self, session: Session, channel: str) -> Floats:
        """Signatures at unit strength in a channel, (n, size)."""


@dataclass(frozen=True, slots=True)
class EntryRegressor:
    """Entry of the library at one shape.

    Attributes:
        amount: name of the amount; empty where the effect has none, and its shape is its strength.
        shape: the values of its shapes.
        at: complete values of each column: at unit amount, for a harmonic at phases 0 and pi/2.
    """

    effect: Effect
    amount: str
    shape: tuple[tuple[str, float], ...]
    at: tuple[Mapping[str, float], ...]

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def form(self) -> str:
        """Name of its amount."""
        return self.amount

    @property
    def size(self) -> int:
        """Number of its columns: one, or two for a harmonic."""
        return len(self.at)

    def columns(self, session: Session, channel: str) -> Floats:
        """Signatures at unit strength in a channel, (n, size)."""
        return np.column_stack(
            [session.signature(channel, self.effect, values) for values in self.at]
        )

    def with_shape(self, name: str, value: float) -> "EntryRegressor":
        """Regressor of the same amount with another value of one shape."""
        return entry_regressor(self.effect, self.amount, dict(self.shape) | {name: value})

    def values(self, coefficients: Sequence[float] | Floats) -> dict[str, float]:
        """Values of the effect for the coefficients of the columns."""
        values = dict(self.at[0])
        if self.amount and self.size == 2:
            phase = _phase_of(self.effect, self.amount)
            values[self.amount] = float(np.hypot(*coefficients))
            values[phase] = float(np.arctan2(coefficients[1], coefficients[0]))
        elif self.amount:
            values[self.amount] = float(coefficients[0])
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
    """Name of the phase of an amount; empty where it has none."""
    phases = [p.name for p in _belonging(effect, amount) if p.role is Role.PHASE]
    return phases[0] if phases else ""


def _belonging(effect: Effect, amount: str) -> list[Parameter]:
    """Parameters that say something about an amount."""
    amounts = {p.name for p in effect.parameters if p.role is Role.AMOUNT}
    narrowed = {name for p in effect.parameters for name in p.amounts}
    return [
        p
        for p in effect.parameters
        if amount in p.amounts or (not p.amounts and (amount not in amounts or not narrowed))
    ]


def regressors_of(effect: Effect, session: Session) -> Iterator[EntryRegressor]:
    """Regressors of one entry that a recording could show."""
    amounts = [p.name for p in effect.parameters if p.role is Role.AMOUNT] or [""]
    ranges = Ranges.of_session(session)
    for amount in amounts:
        mine = [p for p in _belonging(effect, amount) if p.role is Role.SHAPE]
        grids = [[(p.name, value) for value in grid(p, ranges)] for p in mine]
        for shape in itertools.product(*grids):
            yield entry_regressor(effect, amount, dict(shape))


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges that a recording covers.

    Attributes:
        strongest_nm: greatest torque, less what noise may add to it.
        often_nm: torque that is exceeded in a quarter of the motion.
        coldest_c, warmest_c: of the housing; NaN where no temperature was recorded.
    """

    fastest_rad_s: float
    duration_s: float
    low_m: float
    high_m: float
    strongest_nm: float
    often_nm: float
    coldest_c: float
    warmest_c: float
    lead_m: float

    @property
    def span_m(self) -> float:
        """Travel, never 0."""
        return max(self.high_m - self.low_m, 1e-3)

    @classmethod
    def of_session(cls, session: Session) -> "Ranges":
        """Ranges over all runs."""
        motions = [run.motion for run in session.runs]
        temperature_c = np.concatenate([m.temperature_c for m in motions])
        known = temperature_c[np.isfinite(temperature_c)]
        return cls(
            max(float(np.abs(m.speed_rad_s).max()) for m in motions),
            max(float(m.time_s[-1]) for m in motions) - min(float(m.time_s[0]) for m in motions),
            min(float(m.position_m.min()) for m in motions),
            max(float(m.position_m.max()) for m in motions),
            max(_strongest_nm(run) for run in session.runs),
            float(np.quantile(np.concatenate([_moved_nm(run) for run in session.runs]), _OFTEN)),
            float(known.min()) if len(known) else math.nan,
            float(known.max()) if len(known) else math.nan,
            2.0 * math.pi * session.baseline.ratio_m_per_rad,
        )


def _moved_nm(run: Run) -> Floats:
    """Size of the torque while the axis moves, N m; 0 where it is not known."""
    moved = np.abs(run.motion.torque_nm[run.moving]) if run.has_torque else np.zeros(1)
    return moved if len(moved) else np.zeros(1)


def _strongest_nm(run: Run) -> float:
    peak = float(np.nan_to_num(np.abs(run.motion.torque_nm)).max())
    return peak - _NOISE_SIGMAS * run.noise.get(TORQUE, 0.0)


def grid(parameter: Parameter, ranges: Ranges) -> Sequence[float]:
    """Values of a shape worth trying: stated, or by its unit and by what the recording covers."""
    match parameter.unit:
        case _ if parameter.tried:
            values = np.array(parameter.tried)
        case _ if parameter.tried_of_travel:
            values = ranges.span_m * np.array(parameter.tried_of_travel)
        case "rad/s":
            values = np.geomspace(0.3, max(0.25 * ranges.fastest_rad_s, 3.0), 8)
        case "s":
            values = np.geomspace(0.05, 2.0, 6) * max(ranges.duration_s, _WARMING_S)
            values = np.unique(np.maximum(values, _WARMING_S))
        case "degC":
            values = _temperatures(ranges)
        case "K":
            values = np.array(_SPANS_K)
        case "m":
            values = _lengths(parameter, ranges)
        case "N m":
            low, high = ranges.often_nm, 0.99 * ranges.strongest_nm
            values = np.geomspace(low, high, 16) if 0.0 < low < high else np.empty(0)
        case "1":
            values = np.array([1.0, 2.0])
        case _:
            values = parameter.faulty * np.geomspace(0.1, 10.0, 6)
    return [float(v) for v in values if parameter.low <= v <= parameter.high]


def _temperatures(ranges: Ranges) -> Floats:
    """References worth trying; none where the temperature is not known to change."""
    if not ranges.warmest_c - ranges.coldest_c >= _LEAST_WARMING_K:
        return np.empty(0)
    return np.linspace(ranges.coldest_c, ranges.warmest_c, 5)


def _lengths(parameter: Parameter, ranges: Ranges) -> Floats:
    """Lengths worth trying: along the travel, or of what gives and sticks."""
    if parameter.name == "wavelength_m":
        most = math.ceil(2.0 * ranges.span_m / (_LEAST_LEADS * ranges.lead_m))
        return 2.0 * ranges.span_m / np.arange(1.0, min(most, _MOST_WAVES) + 1.0)
    if parameter.name.startswith("centre"):
        return np.linspace(ranges.low_m, ranges.high_m, 25)
    return np.geomspace(1e-6, 2e-4, 12)
