"""Noise of a session: what no fit can explain, and how much of a residual matters.

What smooth functions of the motion say of the gap in another block of time is no noise, whatever
the name of its cause, nor is what comes again at the same place at the same speed. Bursts, such as
those of a force, are not either. Hats over speed, position, acceleration and time, also turned with
the direction, and waves over the angle claim but that like motion gives a like gap.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from scipy import stats
from scipy.spatial import KDTree

from ...messages.samples import Floats, Integers
from ...models.machine import Machine
from ...regression import chance_of_misfit
from ...regression.linear import effective_size
from ...regression.run import FILTER_ORDER, Filter
from ..session.recordings import STEPS, STRETCH
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session, rms

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
LEAST_EFFECTIVE = 40.0
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""
MOST_OF_TORQUE = 0.1
"""Of the torque in motion: a gap beyond that is acted on, however much else is noise."""
TOLERANCE_OF_TORQUE = 1e-3
"""The same over the greatest torque: drives state their torque in such steps."""
INTERPOLATION_M = 5e-8
"""Error of interpolation within a signal period of a good linear encoder (assumption)."""
_PIECE_ROWS = 24
_MOST_SPREAD = 0.6
"""Of the logarithm of the pieces' root mean squares; beyond it pieces are not of one kind."""
_SAME_RAD, _SAME_SPEED, _SAME_ACCELERATION = 0.05, 0.1, 0.3
"""Rows are repeats within so much of the motor's angle, and so much in log(1 + .) of the others."""
_SLOW_RAD_S, _SOFT_RAD_S2 = 1.0, 50.0
_LEAST_REPEATS, _MOST_REPEATS = 200, 4000
REPEATS_MAY_MISS = 1.3
"""Repeats are few, and lie where the axis goes most: by so much they may be too quiet."""
_MORE_THAN_NOISE = 1.5
"""Root mean square over the floor from which on a rest shows nothing of its noise."""
_HIGHEST_ORDER = {TORQUE_GAP: 96, TRANSMISSION_GAP: 12}
_MOST_WAVES = 4
"""Strongest orders that are kept, of those that turn with the direction and those that do not."""
_COUNTS = {"speed": 9, "place": 12, "hard": 9, "time": 8}
_PLAIN_COLUMNS, _PLAIN = 4, 30.0
"""A constant, direction, speed and acceleration come first: a ridge hardly holds them."""
_WAVE_ROWS = 20_000
_EVEN_RAD_S, _EVEN_RAD_S2 = 0.5, 20.0
"""Below these the hats over speed and acceleration lie evenly, above them by octaves."""
_LEAST_SHOWN = 0.03
"""Root mean square below which a column counts as hardly there: others rows may show it in full."""
_RIDGES = (3e-4, 1e-2, 0.3, 1e9)
"""Columns have a mean square of 1, the plainest ones a greater one; the last ridge holds all at 0,
where nothing that they say helps."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise that a fit cannot explain, by channel."""

    floor: Mapping[str, float]  # root mean square that a healthy axis leaves
    tolerance: Mapping[str, float]  # root mean square that nobody needs to know the cause of
    # independent observations among the rows; bounded, for the library approximates
    effective: Mapping[str, float]
    # root mean square below which one fit is no better than another
    discrepancy: Mapping[str, float]

    @classmethod
    def of_gap(cls, session: Session, machine: Machine) -> Self:
        """Noise as the gap itself shows it, before anything is fitted."""
        gaps = {name: rows.gap for name, rows in session.channels.items()}
        levels, _ = noise_floor(session, gaps, structure_of_gap(session))
        # a recording of an ailing machine says nothing of how quiet the healthy one is
        floor = {name: session.healthy_floor.get(name, each) for name, each in levels.items()}
        return cls(
            floor=floor,
            tolerance=stated_tolerance(machine, floor, session.torque_rms_nm),
            effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
            discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
        )

    def of_residual(self, session: Session, machine: Machine, left: Mapping[str, Floats]) -> Self:
        """Noise as what a fit has `left`, (n,), shows it: independent rows, and a lower floor."""
        levels, noise = noise_floor(session, left)
        known = session.healthy_floor
        floor = {n: min(known.get(n, levels[n]), each) for n, each in self.floor.items()}
        tolerance = stated_tolerance(machine, floor, session.torque_rms_nm)
        effective = {}
        for name, each in noise.items():
            # structure, or bursts, hide how the noise goes on
            is_hidden = rms(each) >= _MORE_THAN_NOISE * levels[name]
            independent = math.inf if is_hidden else effective_size(each)
            effective[name] = float(np.clip(independent, LEAST_EFFECTIVE, MOST_EFFECTIVE))
        return replace(self, effective=effective, floor=floor, tolerance=tolerance)

    def beyond(self, channel: str, rms: float) -> float:
        """Part of a root mean square that is not the floor's."""
        return math.sqrt(max(rms**2 - self.floor[channel] ** 2, 0.0))

    def matters(self, channel: str, rms: float) -> bool:
        """Excess of a root mean square over the floor by more than the tolerance."""
        return self.beyond(channel, rms) > self.tolerance[channel]

    def chance(self, channel: str, rms: float) -> float:
        """Chance that a healthy axis, with floor and tolerance, leaves as much: of an F-test."""
        healthy = self.floor[channel] ** 2 + self.tolerance[channel] ** 2
        return chance_of_misfit(rms**2, healthy, self.effective[channel])

    def variance(self, channel: str, rms: float) -> float:
        """Variance of an observation by a fit that leaves a root mean square."""
        return rms**2 + self.discrepancy[channel] ** 2

    def unexplained_shares(
        self, session: Session, left_rms: Mapping[str, float]
    ) -> dict[str, float]:
        """Share of each channel's energy above the floor that is left, `left_rms` by channel.

        A remainder within the tolerance counts as none.
        """
        found = {}
        for name, rows in session.channels.items():
            above, left = self.beyond(name, rows.rms), left_rms[name]
            counts = above > 0.0 and self.matters(name, left)
            found[name] = min((self.beyond(name, left) / above) ** 2, 1.0) if counts else 0.0
        return found


def healthy_gap(machine: Machine) -> dict[str, float]:
    """Root mean square of the gap of the commissioned axis, by channel; empty if not known."""
    return machine.commissioned.gap if machine.commissioned else {}


def stated_tolerance(
    machine: Machine, floor: Mapping[str, float], torque_nm: float
) -> dict[str, float]:
    """Gap beyond the floor that nobody acts on, by channel.

    As the machine file states it; otherwise as much as the floor, in the torque no more than a
    tenth of that in motion and no less than a thousandth of the drive's greatest, and what a
    linear encoder's own interpolation makes. What the recordings of the commissioning have beyond
    the floor belongs to the healthy axis.

    Args:
        torque_nm: root mean square of the torque in motion.
    """
    told, least_nm = machine.tolerance, TOLERANCE_OF_TORQUE * (machine.axis.max_torque_nm or 0.0)
    stated = {TORQUE_GAP: told.torque_nm, TRANSMISSION_GAP: told.position_m}
    least = {TORQUE_GAP: least_nm, TRANSMISSION_GAP: INTERPOLATION_M}
    most = {TORQUE_GAP: MOST_OF_TORQUE * torque_nm}
    healthy, found = healthy_gap(machine), {}
    for name, each in floor.items():
        own = (REPEATS_MAY_MISS * healthy.get(name, 0.0)) ** 2 - each**2
        usual = min(max(each, math.sqrt(max(own, 0.0))), most.get(name, math.inf))
        found[name] = stated[name] or max(usual, least[name])
    return found


def steps_nm(session: Session) -> float:
    """Root mean square that coarse steps of the torque leave in it, N m; otherwise 0."""
    return max(run.noise.get(STEPS, 0.0) for run in session.runs)


def noise_floor(
    session: Session, left: Mapping[str, Floats], structure: Mapping[str, Floats] | None = None
) -> tuple[dict[str, float], dict[str, Floats]]:
    """Root mean square of the noise of what is left, and what holds it, (n,), by channel.

    `structure` is what is predicted of it, where that is known.
    """
    structure = predicted_structure(session, left) if structure is None else structure
    # most that two encoders read apart by chance: what is smooth between samples is not
    noise_m = max(r.noise.get(STRETCH, 0.0) * math.hypot(*r.low_pass.taps) for r in session.runs)
    apart_m = math.hypot(REPEATS_MAY_MISS * noise_m, INTERPOLATION_M)
    levels, noise = {}, {}
    for name, each in left.items():
        rest, rows = each - structure[name], session.channels[name]
        again = _repeated_rms(rows, rest, session.baseline.ratio_m_per_rad, session.fold[name])
        least, most = (steps_nm(session), math.inf) if name == TORQUE_GAP else (0.0, apart_m)
        levels[name] = max(min(ordinary_rms(rest), REPEATS_MAY_MISS * again, most), least)
        noise[name] = rest
    return levels, noise


def ordinary_rms(values: Floats) -> float:
    """Root mean square of a series (n,), as the middle half of its pieces shows it.

    The pieces' own root mean squares are taken for log-normal.
    """
    whole = rms(values)
    count = len(values) // _PIECE_ROWS
    if count < 4:
        return whole
    pieces = values[: count * _PIECE_ROWS].reshape(count, _PIECE_ROWS)
    logarithm = 0.5 * np.log(np.maximum(np.mean(pieces**2, axis=1), 1e-300))
    low, high = np.quantile(logarithm, (0.25, 0.75))
    spread = min(float(stats.iqr(logarithm, scale="normal")), _MOST_SPREAD)
    return min(float(np.exp(0.5 * (low + high) + spread**2)), whole)


def _repeated_rms(rows: Rows, values: Floats, ratio_m_per_rad: float, fold: Integers) -> float:
    """Root mean square of a series (n,) as its repeats differ; infinite where they are too few."""
    known = rows.variables
    pace = paces(known["motor_speed_rad_s"], known["motor_acceleration_rad_s2"])
    state = np.column_stack((known["table_position_m"] / ratio_m_per_rad / _SAME_RAD, pace))
    even, odd = np.flatnonzero(fold % 2 == 0), np.flatnonzero(fold % 2 == 1)
    apart, nearest = KDTree(state[odd]).query(state[even], distance_upper_bound=1.0)
    order = np.argsort(apart)[:_MOST_REPEATS]
    order = order[np.isfinite(apart[order])]
    if len(order) < _LEAST_REPEATS:
        return math.inf
    differ = values[even[order]] - values[odd[nearest[order]]]
    return float(np.median(np.abs(differ)) / stats.norm.ppf(0.75) / np.sqrt(2.0))


def paces(speed_rad_s: Floats, acceleration_rad_s2: Floats) -> Floats:
    """Speed and acceleration as repeats of one another are near in, (n, 2)."""
    speed = np.sign(speed_rad_s) * np.log1p(np.abs(speed_rad_s) / _SLOW_RAD_S)
    hard = np.sign(acceleration_rad_s2) * np.log1p(np.abs(acceleration_rad_s2) / _SOFT_RAD_S2)
    return np.column_stack((speed / _SAME_SPEED, hard / _SAME_ACCELERATION))


@dataclass(frozen=True, slots=True, eq=False)
class SmoothFunctions:
    """Basis of smooth functions, spread over some rows, to be evaluated at any others."""

    # coordinate -> range in the rows that they were made for; beyond it they stay level
    spans: Mapping[str, tuple[float, float]]
    orders: tuple[tuple[int, ...], tuple[int, ...]]  # of the waves over the angle, (even, turned)
    scale: Floats  # of each column, (p,): its root mean square where they were made, or less
    low_pass: Filter

    @classmethod
    def fitted(
        cls, rows: Rows, channel: str, low_pass: Filter, *, timed: bool
    ) -> tuple[Self, Floats]:
        """Basis that is to follow the gap of some rows, and its columns at these, (n, p)."""
        at = _coordinates(rows.variables)
        names = [name for name in at if timed or name != "time"]
        spans = {name: (float(at[name].min()), float(at[name].max())) for name in names}
        orders = _strongest(rows, _HIGHEST_ORDER[channel], low_pass)
        columns = cls(spans, orders, np.ones(1), low_pass).columns(rows.variables)
        scale = np.sqrt(np.mean(columns**2, axis=0))
        scale[:_PLAIN_COLUMNS] /= _PLAIN
        scale = np.maximum(scale, _LEAST_SHOWN)
        return cls(spans, orders, scale, low_pass), columns / scale

    def columns(self, variables: Mapping[str, Floats]) -> Floats:
        """Columns of the basis at some rows, (n, p)."""
        known, way = _coordinates(variables), _way(variables)[:, None]
        at = {name: np.clip(known[name], *span) for name, span in self.spans.items()}
        smooth = [_hats(at[name], *span, _COUNTS[name]) for name, span in self.spans.items()]
        fastest = _EVEN_RAD_S * np.expm1(max(map(abs, self.spans["speed"])))
        hardest = _EVEN_RAD_S2 * np.expm1(max(map(abs, self.spans["hard"])))
        speed = np.clip(variables["motor_speed_rad_s"], -fastest, fastest)
        acceleration = np.clip(variables["motor_acceleration_rad_s2"], -hardest, hardest)
        plain = np.column_stack((np.ones_like(speed), way, speed, acceleration))
        products = [speed * at["place"], acceleration * at["place"]]
        if "time" in at:
            products += [at["time"] * x for x in (speed, at["place"], at["time"] * at["place"])]
        parts = [plain, *smooth, *(way * each for each in smooth), *(x[:, None] for x in products)]
        even, turned = self.orders
        parts += [_wave(variables, order, self.low_pass) for order in even]
        parts += [way * _wave(variables, order, self.low_pass) for order in turned]
        return np.asarray(np.column_stack(parts) / self.scale)


def _coordinates(variables: Mapping[str, Floats]) -> dict[str, Floats]:
    """Variables as the hats are spread over them: fine where friction and inertia change most."""
    speed, acceleration = variables["motor_speed_rad_s"], variables["motor_acceleration_rad_s2"]
    return {
        "speed": np.log1p(np.abs(speed) / _EVEN_RAD_S),
        "place": variables["table_position_m"],
        "hard": np.sign(acceleration) * np.log1p(np.abs(acceleration) / _EVEN_RAD_S2),
        "time": variables["time_s"],
    }


def _way(variables: Mapping[str, Floats]) -> Floats:
    return np.where(variables["direction"] < 0.0, -1.0, 1.0)


def _wave(variables: Mapping[str, Floats], order: int, low_pass: Filter) -> Floats:
    """Sine and cosine of an order, as weak as the low-pass leaves them at each speed, (n, 2)."""
    gain = _gain(variables, order, low_pass)
    turned = order * variables["motor_angle_rad"]
    return np.column_stack((gain * np.sin(turned), gain * np.cos(turned)))


def _gain(variables: Mapping[str, Floats], order: int, low_pass: Filter) -> Floats:
    """Part of an order's amplitude that passes at each speed, (n,)."""
    return passed_at(order * np.abs(variables["motor_speed_rad_s"]) / (2.0 * np.pi), low_pass)


def passed_at(frequency_hz: Floats, low_pass: Filter) -> Floats:
    """Part of an amplitude that passes at some frequencies, (n,)."""
    if len(low_pass.taps) == 1:
        return np.ones_like(frequency_hz)
    share = (frequency_hz / low_pass.cutoff_hz) ** 2
    return np.asarray(1.0 / (1.0 + share**FILTER_ORDER))


def _strongest(
    rows: Rows, highest: int, low_pass: Filter
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Orders of the waves that follow the gap best, each alone: even ones, and turned ones."""
    few = rows.at(slice(None, None, max(len(rows.gap) // _WAVE_ROWS, 1)))
    rest = few.gap - float(np.mean(rows.gap))
    wave, turn = np.ones(len(rest), np.complex128), np.exp(1j * few.variables["motor_angle_rad"])
    strength = []
    for order in range(1, highest + 1):
        wave *= turn
        passed = _gain(few.variables, order, low_pass) * wave
        energy = max(float(np.sum(np.abs(passed) ** 2)), 1e-300)
        sums = passed @ np.column_stack((rest, _way(few.variables) * rest))
        strength.append(np.abs(sums) ** 2 / energy)
    ranked = np.argsort(-np.array(strength), axis=0, kind="stable")[:_MOST_WAVES] + 1
    even, turned = np.sort(ranked, axis=0).T.tolist()
    return tuple(even), tuple(turned)


def _hats(values: Floats, low: float, high: float, count: int) -> Floats:
    """Piecewise linear functions that add up to 1, (n, count)."""
    knots = np.linspace(low, high + 1e-12 + 1e-9 * abs(high), count)
    reach = knots[1] - knots[0]
    return np.asarray(np.maximum(1.0 - np.abs(values[:, None] - knots) / reach, 0.0))


def ridge_fits(columns: Floats, values: Floats, ridges: Sequence[float]) -> Floats:
    """Coefficients of columns (n, p) that follow values (n,), for each ridge per row, (r, p)."""
    held = np.array(ridges)[:, None, None] * len(columns) * np.eye(columns.shape[1])
    normal, target = columns.T @ columns + held, (columns.T @ values)[:, None]
    return np.linalg.solve(normal, target)[..., 0].astype(np.float64)


def predicted_groups(
    rows: Rows, group: Integers, channel: str, low_pass: Filter, *, timed: bool
) -> tuple[float, Floats]:
    """Ridge that predicts each group of rows best from the others, and the prediction, (n,)."""
    found = np.zeros((len(_RIDGES), len(rows.gap)))
    for number in np.unique(group).tolist():
        mine = group == number
        if not mine.all():
            forms, known = SmoothFunctions.fitted(rows.at(~mine), channel, low_pass, timed=timed)
            asked = forms.columns(rows.at(mine).variables)
            found[:, mine] = ridge_fits(known, rows.gap[~mine], _RIDGES) @ asked.T
    best = int(np.argmin(np.sum((rows.gap - found) ** 2, axis=1)))
    return _RIDGES[best], found[best]


def predicted_structure(
    session: Session, left: Mapping[str, Floats], *, timed: bool = True
) -> dict[str, Floats]:
    """Prediction by smooth functions on blocks not fitted, by channel; 0 where none helps.

    Args:
        left: what something leaves of the gap, by channel, (n,).
        timed: functions of time are among them; otherwise of the motion alone.
    """
    low_pass, folds, predicted = session.runs[0].low_pass, session.fold, {}
    for channel, values in left.items():
        rows = replace(session.channels[channel], gap=values)
        _, best = predicted_groups(rows, folds[channel], channel, low_pass, timed=timed)
        predicted[channel] = best
    return predicted


@lru_cache(maxsize=1)
def structure_of_gap(session: Session) -> Mapping[str, Floats]:
    """Prediction of the gap itself, see `predicted_structure`; that of the last session is kept."""
    return predicted_structure(session, {name: each.gap for name, each in session.channels.items()})
