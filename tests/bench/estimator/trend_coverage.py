"""Coverage of the true date of reaching the limit by the trend's band, on years of wear."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.health.wear.trend import CERTAIN, LEVEL, project_wear
from edge_service.messages.samples import Floats

from ..table import Table

WEARING = ("linear", "run-in", "accelerating", "decelerating", "stepwise", "wandering")
DAY_S = 86400.0
_LONGEST_DAYS = 3000
_LONGEST_AGE = 4.0


@dataclass(frozen=True, slots=True)
class Life:
    """One simulated screw, day by day: what was estimated, and when it really reaches the limit.

    Attributes:
        time_s, distance_m, percent: of each day until the question is asked, (n,).
        half_width_percent: of the estimator's 95 % interval.
        limit_percent: the limit.
        crossing_s: true time of reaching it, s.
    """

    time_s: Floats
    distance_m: Floats
    percent: Floats
    half_width_percent: float
    limit_percent: float
    crossing_s: float


@dataclass(frozen=True, slots=True)
class Coverage:
    """Outcome over many lives.

    Attributes:
        asked: lives in which the question was asked.
        dated: those with a band.
        inside: those of them whose band holds the truth.
        median_width: median width of the bands, share of the time remaining.
    """

    asked: int
    dated: int
    inside: int
    median_width: float

    @property
    def share(self) -> float:
        """Share of bands that hold the truth."""
        return self.inside / self.dated


def loss(law: str, age: Floats, rng: np.random.Generator) -> Floats:
    """Wear at ages (n,), about 1 at age 1; rising.

    Running in follows an exponential, which is none of the shapes that the trend knows; steps are
    a compound Poisson process on top of slow wear; `wandering` is a rate that walks at random.
    """
    worn: Floats = np.zeros_like(age)
    match law:
        case "linear":
            worn = age
        case "run-in":
            share, length = rng.uniform(0.2, 0.5), rng.uniform(0.03, 0.15)
            worn = share * -np.expm1(-age / length) + (1.0 - share) * age
        case "accelerating":
            worn = age ** rng.uniform(1.3, 2.2)
        case "decelerating":
            worn = age ** rng.uniform(0.5, 0.8)
        case "stepwise":
            per_age = int(rng.integers(6, 16))
            count = int(per_age * age[-1]) + 1
            at, height = rng.uniform(0.0, age[-1], count), rng.exponential(1.0 / per_age, count)
            worn = 0.3 * age + 0.7 * ((age[:, None] >= at) @ height)
        case "wandering":
            rate = np.exp(np.clip(np.cumsum(0.12 * rng.standard_normal(age.size)), -1.2, 1.2))
            worn = np.cumsum(rate * np.gradient(age))
            worn -= worn[0]
    return worn


def simulate_life(rng: np.random.Generator) -> Life:
    """Wear by one of several laws; more preload wears faster."""
    start = rng.uniform(4.0, 10.0)
    life_m = 3.0e6 / (start / 7.0) * np.exp(0.3 * rng.standard_normal())
    weekday = np.arange(_LONGEST_DAYS) % 7
    slow = 0.15 * np.cumsum(rng.standard_normal(_LONGEST_DAYS)) / np.sqrt(200.0)
    daily_m = np.where(weekday < 5, 7000.0, 1500.0) * np.exp(
        0.25 * rng.standard_normal(_LONGEST_DAYS) + np.clip(slow, -0.4, 0.4)
    )
    distance_m: Floats = np.cumsum(daily_m).astype(np.float64)
    law = WEARING[rng.integers(len(WEARING))]
    worn = loss(law, np.minimum(distance_m / life_m, _LONGEST_AGE), rng)
    limit = 0.3 * start
    truth = np.maximum(start - (start - limit) * worn, 0.0)
    crossing = int(np.argmax(truth <= limit))
    half_width = rng.uniform(0.1, 0.4)
    bias = half_width / 1.96 * rng.standard_normal()
    errors = bias + _errors(rng, truth.size)
    ask = int(crossing * rng.uniform(0.2, 0.95))
    time_s = np.arange(1.0, _LONGEST_DAYS + 1.0, dtype=np.float64) * DAY_S
    seen = slice(0, max(ask, 2))
    return Life(
        time_s[seen],
        distance_m[seen],
        (truth + errors)[seen],
        half_width,
        limit,
        float(time_s[crossing]),
    )


def _errors(rng: np.random.Generator, count: int) -> Floats:
    """Scatter from day to day, and a part that drifts over days."""
    memory = np.exp(-1.0 / rng.uniform(1.0, 6.0))
    drift = np.empty(count)
    drift[0] = rng.standard_normal()
    steps = np.sqrt(1.0 - memory**2) * rng.standard_normal(count)
    for day in range(1, count):
        drift[day] = memory * drift[day - 1] + steps[day]
    return rng.uniform(0.02, 0.12) * rng.standard_normal(count) + rng.uniform(0.0, 0.15) * drift


def crossing_draws(
    time_s: Floats, distance_m: Floats, percent: Floats, sigma_level: float, limit_percent: float
) -> Floats | None:
    """Time from now until the limit is reached, s, in equally likely projections.

    None if it is too early, or if it cannot be told whether the preload falls.
    """
    future = project_wear(time_s, distance_m, percent, sigma_level)
    if future is None or np.mean(future.draws.slope < 0.0) < CERTAIN:
        return None
    return future.seconds_to(limit_percent)


def coverage(lives: int, seed: int = 1) -> Coverage:
    """Ask once in each of many lives."""
    rng = np.random.default_rng(seed)
    inside, widths = 0, []
    for _ in range(lives):
        life = simulate_life(rng)
        band = crossing_draws(
            life.time_s,
            life.distance_m,
            life.percent,
            life.half_width_percent / 1.96,
            life.limit_percent,
        )
        if band is None:
            continue
        tail = 50.0 * (1.0 - LEVEL)
        low, high = np.percentile(band, [tail, 100.0 - tail])
        remaining = life.crossing_s - life.time_s[-1]
        inside += bool(low <= remaining <= high)
        widths.append((high - low) / remaining)
    return Coverage(lives, len(widths), inside, float(np.median(widths)))


def trend_table(parts: Sequence[Coverage]) -> Table:
    """One row over all lives."""
    (found,) = parts
    heads = ("screws of six laws", "dated", "90 % band holds the date", "its median width")
    return Table(heads, ((found.asked, found.dated, found.share, found.median_width),))
