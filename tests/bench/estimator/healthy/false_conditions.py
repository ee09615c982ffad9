"""Judgement of healthy production by the health room: false WARNING, FAULT and alarms, counted.

Estimates and intervals go to the same watch as in the service, on a clock made of the recording's
time, so hours pass as fast as they can be computed.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import chi2

from edge_service.estimate.interface import PreloadEstimator
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.health.alarms.axis_alarms import AlarmSettings
from edge_service.health.axis_monitor import AxisFacts, AxisMonitor
from edge_service.health.settings import HealthSettings
from edge_service.health.trend.usage import ScrewGeometry
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.event import Event
from edge_service.messages.features import FeatureBlock
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition
from edge_service.models.machine import Machine

from ...table import Section
from ..scores import Score, Track, follow, pooled, score
from .production_cases import draw_shift, produced

MINUTES, QUICK_MINUTES = 300.0, 10.0
PER_MIN = 10_000.0
TICK_BLOCKS = 10
START_NS = 1_700_000_000 * 10**9
FALSE = (AxisCondition.WARNING, AxisCondition.FAULT)
HEADS: tuple[str, ...] = (
    "wrong",
    "rows",
    "axes",
    "min",
    "WARNING",
    "FAULT",
    "at most",
    "min false",
)
HEADS += ("unavailable", "alarms", "MAE", "cover")


@dataclass(frozen=True, slots=True)
class WatchCount:
    """Counts of what a watch said of one shift.

    Attributes:
        conditions: how often each condition began.
        alarms: how often each kind was raised.
        condition_s: how long each condition stood.
    """

    conditions: Mapping[str, int]
    alarms: Mapping[str, int]
    condition_s: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class ShiftPart:
    """One shift with a new start of the estimator."""

    plant: str
    axis_seed: int
    minutes: float
    count: WatchCount
    score: Score
    track: Track


class Watched:
    """An estimator whose every interval and estimate goes to the health room as well."""

    def __init__(self, estimator: PreloadEstimator, machine: Machine) -> None:
        self._estimator = estimator
        geometry = ScrewGeometry(machine.transmission_ratio_m_per_rad, machine.axis.stroke_m)
        facts = AxisFacts(machine.axis.name, machine.fresh_preload_percent, geometry)
        self._watch = AxisMonitor(facts, HealthSettings(), AlarmSettings(), START_NS)
        self._sequence, self._now_ns = 0, START_NS
        self._conditions: Counter[str] = Counter()
        self._alarms: Counter[str] = Counter()
        self._condition_s: defaultdict[str, float] = defaultdict(float)
        self._condition = AxisCondition.UNAVAILABLE.value

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval; once for each `estimate`."""
        self._estimator.update(block)
        self._now_ns = START_NS + round(block.time_s * 1e9)
        self._condition_s[self._condition] += block.duration_s
        self._note(self._watch.on_feature(self._header(), block, self._now_ns))

    def estimate(self) -> PreloadEstimate:
        """Current estimate, once the watch has taken it."""
        estimate = self._estimator.estimate()
        self._note(self._watch.on_preload(self._header(), estimate, self._now_ns))
        self._sequence += 1
        if self._sequence % TICK_BLOCKS == 0:
            self._note(self._watch.tick(self._now_ns))
            if self._watch.trend_is_due(self._now_ns):
                self._watch.take_trend(self._watch.trend_work()(), self._now_ns)
        return estimate

    def count(self) -> WatchCount:
        """Counts of what was said so far."""
        return WatchCount(dict(self._conditions), dict(self._alarms), dict(self._condition_s))

    def _header(self) -> Header:
        return Header(self._sequence, START_NS, self._now_ns, self._now_ns)

    def _note(self, events: Iterable[Event]) -> None:
        for event in events:
            if event.kind == "condition_changed":
                self._condition = AxisCondition(str(event.data["to"])).value
                self._conditions[self._condition] += 1
            elif event.kind == "alarm_raised":
                self._alarms[str(event.data["alarm"])] += 1


def watched_shift(plant: str, axis_seed: int, duration_s: float) -> ShiftPart:
    """One shift of healthy production, watched."""
    shift = draw_shift(plant, axis_seed, duration_s)
    machine, recorded = produced(shift)
    watched = Watched(MixturePreloadEstimator(machine), machine)
    track = follow(watched, recorded)
    return ShiftPart(plant, axis_seed, duration_s / 60.0, watched.count(), score(track), track)


def shifts(plant: str, first_seed: int, count: int, duration_s: float) -> Iterator[ShiftPart]:
    """Shifts of so many axes."""
    for axis_seed in range(first_seed, first_seed + count):
        yield watched_shift(plant, axis_seed, duration_s)


def upper_bound(count: int, minutes: float) -> float:
    """95 % upper bound of a rate per `PER_MIN` minutes, from a count that is Poisson.

    Without any event 3.0 / minutes, the rule of three.
    """
    return float(chi2.ppf(0.95, 2 * count + 2)) / 2.0 / minutes * PER_MIN


def healthy_section(parts: Sequence[ShiftPart]) -> Section:
    """One row for each plant, and all of them."""
    plants = tuple(dict.fromkeys(part.plant for part in parts))
    rows = [(plant, _figures([p for p in parts if p.plant == plant])) for plant in plants]
    rows.append(("all", _figures(parts)))
    shortest = min(part.axis_seed for part in parts), max(part.axis_seed for part in parts)
    return Section(
        name="healthy",
        title=f"healthy production (axis seeds {shortest[0]} to {shortest[1]})",
        heads=HEADS,
        rows=tuple(rows),
        notes=(
            "WARNING, FAULT: how often the condition became so, at most so many of both together "
            f"per {PER_MIN:,.0f} min with 95 % confidence; min false: time in them; alarms: raised",
            *(_complaint(part) for part in parts if _false(part) or part.count.alarms),
        ),
    )


def _false(part: ShiftPart) -> int:
    return sum(part.count.conditions.get(each.value, 0) for each in FALSE)


def _complaint(part: ShiftPart) -> str:
    """Line on what was said of one healthy axis."""
    answered = {name: n for name, n in part.count.conditions.items() if name in set(FALSE)}
    each = ", ".join(f"{name} {n}" for name, n in (answered | dict(part.count.alarms)).items())
    return f"  {part.plant} {part.axis_seed}: {each}"


def _figures(parts: Sequence[ShiftPart]) -> tuple[object, ...]:
    minutes = sum(part.minutes for part in parts)
    together = pooled(part.score for part in parts)
    begun: Counter[str] = Counter()
    stood_s: defaultdict[str, float] = defaultdict(float)
    for part in parts:
        begun.update(part.count.conditions)
        for name, spent_s in part.count.condition_s.items():
            stood_s[name] += spent_s
    false = sum(begun[each.value] for each in FALSE)
    return (
        together.wrong,
        together.answered,
        len(parts),
        round(minutes, 1),
        begun[AxisCondition.WARNING.value],
        begun[AxisCondition.FAULT.value],
        upper_bound(false, minutes),
        sum(stood_s[each.value] for each in FALSE) / 60.0,
        stood_s[AxisCondition.UNAVAILABLE.value] / 60.0 / minutes,
        sum(sum(part.count.alarms.values()) for part in parts),
        together.mae,
        together.coverage,
    )
