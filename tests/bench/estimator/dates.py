"""Dates of limits on drawn lives of screws: given, held, how wide, and beside simpler laws."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from scipy.stats import gaussian_kde, norm

from edge_service.config_tables import AlarmsConfig
from edge_service.health.alarms import slowest_loss
from edge_service.health.wear.trend import PreloadHistory, preload_trend, sure_points
from edge_service.health.wear.wear_laws import project_wear
from edge_service.messages.samples import Floats, Integers
from edge_service.offline.reproduce.wear import first_crossing_h

from ..table import Table, mean_of

LAWS: tuple[str, ...] = (
    "linear",
    "running in",
    "decelerating",
    "accelerating",
    "exponential",
    "sigmoid",
)
LAWS += ("stepwise", "gamma process")
HEALTHY = "healthy"
READINGS, NOTHING = "all laws, readings alone", "nothing: healthy axes"
LIMITS = {"warning": 0.6, "fault": 0.3}
"""Shares of the fresh preload; the second ends a life."""
DRAG_LIMITS = {"90": 0.9, "85": 0.85, "80": 0.8}
"""Shares of the first reading of a drag torque, from which dates are asked as of a preload."""
DAY_S, YEAR_DAYS, STAGE_H = 86400.0, 365.25, 35.0
_QUESTIONS = 4
_EARLIEST, _LATEST = 0.4, 0.95
"""Share of the time to the limit at which a date is asked for."""


def loss(law: str, age: Floats, rng: np.random.Generator) -> Floats:
    """Wear at ages (n,), 1 about at age 1; rising."""
    worn = age
    match law:
        case "running in":
            share, length = rng.uniform(0.2, 0.5), rng.uniform(0.03, 0.15)
            worn = share * -np.expm1(-age / length) + (1.0 - share) * age
        case "accelerating":
            worn = age ** rng.uniform(1.3, 2.2)
        case "decelerating":
            worn = age ** rng.uniform(0.5, 0.8)
        case "exponential":
            rate = rng.uniform(1.0, 3.0)
            worn = np.expm1(rate * age) / math.expm1(rate)
        case "sigmoid":
            middle, width = rng.uniform(0.4, 0.7), rng.uniform(0.12, 0.25)
            begun, done = norm.cdf(-middle / width), norm.cdf((1.0 - middle) / width) + 0.3
            worn = (norm.cdf((age - middle) / width) + 0.3 * age - begun) / (done - begun)
        case "stepwise":
            steps_per_age = int(rng.integers(6, 16))
            count = int(steps_per_age * age[-1]) + 1
            at = rng.uniform(0.0, age[-1], count)
            height = rng.exponential(1.0 / steps_per_age, count)
            worn = 0.3 * age + 0.7 * ((age[:, None] >= at) @ height)
        case "gamma process":
            per_age = rng.uniform(15.0, 60.0)
            steps = rng.gamma(per_age * np.diff(age, prepend=0.0) + 1e-12, 1.0 / per_age)
            worn = np.cumsum(steps)
    return np.asarray(worn)


@dataclass(frozen=True, slots=True, eq=False)
class Life:
    """One drawn screw, estimate by estimate."""

    law: str
    rows: Floats  # time in s, preload, half width, and way in m, of each estimate, (n, 4)
    limits: Mapping[str, float]  # percent, by name
    reached_s: Mapping[str, float]  # true time of each limit

    def history(self, until_s: float) -> PreloadHistory:
        history = PreloadHistory()
        for row in self.rows[self.rows[:, 0] <= until_s].tolist():
            history.add(*row)
        return history


def draw_life(law: str, seed: int) -> Life:
    """Wear by the way or by the hour, seen on every working day or in sessions far apart."""
    rng = np.random.default_rng([seed, (*LAWS, HEALTHY).index(law), 41])
    fresh, life_days = rng.uniform(4.0, 10.0), rng.uniform(120.0, 700.0)
    day = np.linspace(0.0, 3.0 * life_days, 4000)
    shifts = np.exp(0.01 * np.cumsum(rng.standard_normal(day.size)))
    way_m = np.cumsum(np.where(day % 7.0 < 5.0, 1.0, 0.2) * shifts) * rng.uniform(500.0, 5000.0)
    by_way = rng.random() < 0.7
    age = way_m / np.interp(life_days, day, way_m) if by_way else day / life_days
    worn = np.zeros_like(day) if law == HEALTHY else loss(law, age, rng)
    truth = fresh * np.maximum(1.0 - 0.7 * worn, 0.0)
    reached_s = {
        name: DAY_S * first_crossing_h(day, truth, share * fresh) for name, share in LIMITS.items()
    }
    seldom, end_days = rng.random() < 0.5, reached_s["fault"] / DAY_S
    if law == HEALTHY:
        seldom, end_days = True, YEAR_DAYS
    session, at_s = _sessions(
        rng, end_days, 16 if law == HEALTHY else int(rng.integers(16, 40)), seldom
    )
    error, half_width = _errors(rng, session, at_s, fresh * rng.uniform(0.03, 0.12))
    percent = np.maximum(np.interp(at_s / DAY_S, day, truth) + error, 0.0)
    rows = np.column_stack([at_s, percent, half_width, np.interp(at_s / DAY_S, day, way_m)])
    return Life(law, rows, {name: share * fresh for name, share in LIMITS.items()}, reached_s)


def draw_readings(law: str, seed: int) -> Life:
    """Thirty readings of a drag torque on a rig that runs faster and faster, without intervals."""
    rng = np.random.default_rng([seed, LAWS.index(law), 77])
    stage = np.arange(30.0)
    way_m = np.cumsum(stage * rng.uniform(1e4, 1e5))
    age = way_m / way_m[-1] if rng.random() < 0.5 else stage / stage[-1]
    scatter = _remembered(rng, stage, rng.uniform(0.5, 2.5))
    drag = 1.0 - rng.uniform(0.2, 0.4) * loss(law, age, rng) + rng.uniform(0.006, 0.02) * scatter
    percent = 100.0 * drag / drag[0]
    rows = np.column_stack([3600.0 * STAGE_H * stage, percent, np.zeros_like(stage), way_m])
    limits = {name: 100.0 * share for name, share in DRAG_LIMITS.items()}
    reached = {name: first_crossing_h(rows[:, 0], percent, each) for name, each in limits.items()}
    return Life(law, rows, limits, reached)


def _sessions(
    rng: np.random.Generator, end_days: float, count: int, seldom: bool
) -> tuple[Integers, Floats]:
    """Number of the session and time, s, of each estimate, (n,); with holidays."""
    if seldom:
        each, length_s, gaps = 8, rng.uniform(180.0, 600.0), rng.uniform(0.4, 1.6, count)
        begins = (np.cumsum(gaps) - gaps[0]) / gaps.sum() * end_days
    else:
        each, length_s, begins = 4, 8.0 * 3600.0, np.arange(math.floor(end_days)) + 0.25
        holiday = (begins - rng.uniform(0.0, 180.0)) % 180.0 < 21.0
        begins = begins[(begins % 7.0 < 5.0) & ~holiday]
    at_s = begins[:, None] * DAY_S + (np.arange(each) + 0.5) / each * length_s
    return np.repeat(np.arange(begins.size), each), at_s.ravel()


def _errors(
    rng: np.random.Generator, session: Integers, at_s: Floats, half_width: float
) -> tuple[Floats, Floats]:
    """Errors and half widths of estimates, (n,): constant, slow, of season, session and moment."""
    first = np.flatnonzero(np.diff(session, prepend=-1))
    day, normal = at_s[first] / DAY_S, rng.standard_normal((3, first.size))
    season = math.sqrt(2.0) * np.sin(2.0 * np.pi * (day / YEAR_DAYS + rng.random()))
    slow = _remembered(rng, day, rng.uniform(5.0, 40.0))
    shares = np.sqrt(rng.dirichlet(np.ones(5)))
    sigma = half_width / 1.96 * rng.uniform(0.6, 1.1)
    parts = np.stack([np.full(first.size, normal[0, 0]), slow, season, normal[1]])
    outlier = np.where(rng.random(first.size) < 0.02, 1.5 * half_width * normal[2], 0.0)
    error = (sigma * shares[:4] @ parts + outlier)[session]
    error += sigma * shares[4] * rng.standard_normal(session.size)
    widths = (half_width * np.exp(0.2 * rng.standard_normal(first.size)))[session]
    restarted = first[rng.random(first.size) < 0.3]
    error[restarted] += half_width * rng.standard_normal(restarted.size)
    widths[restarted] *= 3.0
    return error, widths


def _remembered(rng: np.random.Generator, at: Floats, memory: float) -> Floats:
    """Values of unit variance that forget themselves, (n,)."""
    gap = np.abs(at[:, None] - at) / memory
    return np.asarray(np.linalg.cholesky(np.exp(-gap)) @ rng.standard_normal(at.size))


@dataclass(frozen=True, slots=True)
class Asked:
    row: str
    # dated, falling, alarmed: whether there was a date, a fall, an alarm of its rate
    dated: bool
    falling: bool = False
    alarmed: bool = False
    missed: int = 0  # -1 if the limit was reached before the band, 1 if after it
    width: float = math.nan  # of the band, share of the time that remained; inf if it is open
    # log densities of the truth, by the logarithm of the time that remained, of the service, a line
    # and an exponential
    scores: tuple[float, ...] = ()


def ask_of_a_law(law: str, seeds: Sequence[int], *, readings: bool) -> Iterator[Asked]:
    """Ask at some times of drawn lives."""
    for seed in seeds:
        life = draw_readings(law, seed) if readings else draw_life(law, seed)
        rng = np.random.default_rng([seed, 5])
        reached = [name for name, at_s in life.reached_s.items() if at_s < math.inf]
        for name in rng.choice(reached, _QUESTIONS if reached else 0):
            until_s = rng.uniform(_EARLIEST, _LATEST) * life.reached_s[name]
            yield answer(life, str(name), until_s, READINGS if readings else law)


def ask_healthy(seeds: Sequence[int]) -> Iterator[Asked]:
    """Ask after each of 16 sessions of a year."""
    for seed in seeds:
        life = draw_life(HEALTHY, seed)
        ends = np.flatnonzero(np.diff(life.rows[:, 0], append=math.inf) > 3600.0)
        for until_s in life.rows[ends, 0]:
            yield answer(life, "warning", until_s, NOTHING)


def answer(life: Life, name: str, until_s: float, row: str) -> Asked:
    """Date that the service gives for a limit at a time, beside the true one."""
    points = life.history(until_s).points()
    time_s, percent = points[:2]
    fresh = life.limits[name] / {**LIMITS, **DRAG_LIMITS}[name]
    trend = preload_trend(*points, life.limits, fresh)
    rate = trend.rate_percent_per_h
    limit_per_h = AlarmsConfig().rate_percent_per_1000_h / 1000.0 * fresh / 100.0
    alarmed = rate is not None and slowest_loss(rate) < -limit_per_h
    found = next((each for each in trend.crossings if each.limit == name), None)
    said = Asked(row, found is not None, trend.status == "falling", alarmed)
    left_s = life.reached_s[name] - float(time_s[-1])
    future = project_wear(*sure_points(*points))
    if found is None or found.earliest_ns is None or future is None or left_s == math.inf:
        return said
    latest_ns = math.inf if found.latest_ns is None else found.latest_ns
    came_ns = 1e9 * life.reached_s[name]
    limit_percent, logs = life.limits[name], np.log(np.maximum(percent, 0.01))
    draws = (
        future.seconds_to(limit_percent),
        line(time_s, percent, limit_percent),
        line(time_s, logs, math.log(limit_percent)),
    )
    return replace(
        said,
        missed=int(came_ns > latest_ns) - int(came_ns < found.earliest_ns),
        width=(latest_ns - found.earliest_ns) / 1e9 / left_s,
        scores=tuple(log_score(each, left_s, float(np.ptp(time_s))) for each in draws),
    )


def line(time_s: Floats, values: Floats, limit: float) -> Floats:
    """Times from now until a line with Gaussian residuals reaches a limit, s, in draws (n,)."""
    rng, scale_s = np.random.default_rng(5), float(np.ptp(time_s))
    design = np.column_stack([np.ones_like(time_s), (time_s - time_s[-1]) / scale_s])
    inverse = np.linalg.inv(design.T @ design)
    mean, freedom = inverse @ design.T @ values, values.size - 2
    rest = float(np.sum((values - design @ mean) ** 2)) / freedom + 1e-12
    spread = np.sqrt(freedom / rng.chisquare(freedom, (2000, 1)))
    level, slope = (mean + spread * rng.multivariate_normal([0.0, 0.0], rest * inverse, 2000)).T
    return np.where(slope < 0.0, scale_s * np.maximum((limit - level) / slope, 0.0), math.inf)


def log_score(draws_s: Floats, left_s: float, scale_s: float) -> float:
    """Log density of the truth by the logarithm of the time; one in a hundred is left to doubt."""
    finite = draws_s[np.isfinite(draws_s)][:2000]
    logs, density = np.log(np.maximum(finite, 1e-3 * scale_s)), 0.0
    if finite.size > 10 and np.ptp(logs) > 1e-6:
        share = float(np.mean(np.isfinite(draws_s)))
        density = share * float(gaussian_kde(logs)(math.log(left_s))[0])
    doubt = float(norm.pdf(math.log(left_s), math.log(scale_s), 2.0))
    return math.log(0.99 * density + 0.01 * doubt)


def dates_table(parts: Sequence[Asked]) -> Table:
    """One row for each law and for all of them, then for readings and for healthy axes."""
    names = list(dict.fromkeys(part.row for part in parts))
    rows = [_row(name, [part for part in parts if part.row == name]) for name in names]
    laws = [name for name in names if name in LAWS]
    rows.insert(len(laws), _row("all laws", [part for part in parts if part.row in laws]))
    healthy = [part for part in parts if part.row == NOTHING]
    dates, falls, alarms = (
        sum(getattr(part, name) for part in healthy) for name in ("dated", "falling", "alarmed")
    )
    return Table.of(
        rows,
        "held: share of the 90 % bands; sooner, later: reached before and after the band; "
        "width: median of the bands, share of the time that remained; scores: mean log "
        "density of what came, of the questions with a date",
        f"healthy axes, after {len(healthy)} sessions: {dates} dates, {falls} falls, "
        f"{alarms} alarms of the rate",
    )


def _row(name: str, asked: Sequence[Asked]) -> Mapping[str, object]:
    share = mean_of([float(each.dated) for each in asked])
    row: dict[str, object] = {"dates: wear by": name, "asked": len(asked), "dated": share}
    dated = [each for each in asked if each.scores]
    if not dated:
        return row
    missed, width = [each.missed for each in dated], [each.width for each in dated]
    ours, line, exponential = np.mean([each.scores for each in dated], axis=0).tolist()
    return row | {
        "held": missed.count(0) / len(dated),
        "sooner": missed.count(-1) / len(dated),
        "later": missed.count(1) / len(dated),
        "open": float(np.mean(np.isinf(width))),
        "width": median(width),
        "log score": ours,
        "line": line,
        "exponential": exponential,
    }
