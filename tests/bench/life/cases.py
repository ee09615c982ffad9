"""Lives of an axis: sessions of some minutes over months, each in another state.

What is drawn is fixed by the seed. What happens to the preload is one of `SHAPES`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from edge_service.messages.samples import Floats

DAY_S = 86_400.0
LIMIT_SHARE = 0.6
"""Of the fresh preload: below it the axis' condition is WARNING."""
_Shape = Callable[[Floats, float], Floats]


def _replaced(age: Floats, event: float) -> Floats:
    return np.asarray(1.0 - 0.62 * np.where(age < event, age / event, (age - event) / 0.9))


SHAPES: Mapping[str, _Shape] = {
    "linear": lambda age, _: 1.0 - 0.65 * age,
    "accelerating": lambda age, _: 1.0 - 0.7 * age**2.5,
    "sudden step": lambda age, event: 1.0 - 0.15 * age - 0.4 * (age >= event),
    "replaced nut": _replaced,
    "healthy": lambda age, _: np.ones_like(age),
}
"""Share of the fresh preload that is left (n,), by the age as share of the life (n,); `event` is
the age of the step, or of the new nut."""


@dataclass(frozen=True, slots=True)
class Session:
    """One recording of a life; the factors are those of its friction, 1 as commissioned."""

    day: float  # of the life on which it begins
    # time_s, percent: preload, straight between these points
    time_s: tuple[float, ...]
    percent: tuple[float, ...]
    warmth: float  # at its start, 0 cold, 1 warm
    nut: float
    guide: float
    bearing: float
    viscous: float
    added_kg: float  # on the table beside the commissioned mass
    seed: int  # of its part program and noise
    clock_s: float  # what its clock shows at its start

    @property
    def duration_s(self) -> float:
        return self.time_s[-1]

    @property
    def start(self) -> str:
        """State in which it begins, one of four."""
        load = "with payload" if self.added_kg else "without payload"
        return f"{'warm' if self.warmth else 'cold'}, {load}"


@dataclass(frozen=True, slots=True)
class Life:
    shape: str
    axis_seed: int
    fresh_percent: float
    days: float
    event: float  # age of the step or of the new nut, as share of the life
    own_clock: bool  # whether every session begins at 0 s, else all are on one clock
    sessions: tuple[Session, ...]

    def crossing_day(self) -> float:
        """Day on which `LIMIT_SHARE` of the fresh preload is first left below; NaN if never."""
        age = np.linspace(0.0, 1.0, 20_001)
        below = SHAPES[self.shape](age, self.event) < LIMIT_SHARE
        return float(age[np.argmax(below)]) * self.days if below.any() else math.nan


def draw_life(
    shape: str, axis_seed: int, fresh_percent: float, count: int = 16, session_s: float = 180.0
) -> Life:
    """A life of 3 sessions or more of such a length; the same arguments give the same life."""
    rng = np.random.default_rng([axis_seed, list(SHAPES).index(shape), 29])
    days = float(rng.uniform(120.0, 300.0))
    jitter = np.append(np.append(0.0, rng.uniform(-0.3, 0.3, count - 2)), 0.0)
    ages = (np.arange(count) + jitter) / (count - 1)
    middle = int(rng.integers(math.ceil(0.45 * count), max(math.ceil(0.7 * count), 2)))
    within = 0.5 * session_s / DAY_S / days
    step = shape == "sudden step"
    event = float(ages[middle] + within if step else 0.5 * (ages[middle - 1] + ages[middle]))
    own_clock = bool(rng.random() < 0.5)
    knots_s = np.array([0.0, 0.5 * session_s - 1e-3, 0.5 * session_s, session_s])
    sessions = []
    for age in ages:
        percent = fresh_percent * SHAPES[shape](age + knots_s / DAY_S / days, event)
        sessions.append(_drawn(rng, float(age) * days, knots_s, percent, own_clock))
    return Life(shape, axis_seed, fresh_percent, days, event, own_clock, tuple(sessions))


def _drawn(
    rng: np.random.Generator, day: float, time_s: Floats, percent: Floats, own_clock: bool
) -> Session:
    """One session in a state of its own; a lubricant is 10 to 20 % off, better or worse."""
    nut, guide = 1.0 + rng.uniform(0.1, 0.2, 2) * rng.choice([-1.0, 1.0], 2)
    return Session(
        day=day,
        time_s=tuple(time_s.tolist()),
        percent=tuple(percent.tolist()),
        warmth=0.0 if rng.random() < 0.4 else float(rng.uniform(0.0, 1.0)),
        nut=float(nut),
        guide=float(guide),
        bearing=float(rng.uniform(0.9, 1.1)),
        viscous=float(rng.uniform(0.85, 1.15)),
        added_kg=float(rng.choice([0.0, 0.0, 5.0, 10.0])),
        seed=int(rng.integers(1, 2**31)),
        clock_s=0.0 if own_clock else day * DAY_S,
    )
