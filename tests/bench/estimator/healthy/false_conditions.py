"""Judgement of healthy production by the health room: false WARNING, FAULT and alarms, counted.

Estimates and intervals go to the same watch as in the service, on a clock made of the recording's
time, so hours pass as fast as they can be computed.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import chi2

from edge_service.config_tables import AlarmsConfig
from edge_service.estimate.interface import PreloadEstimator
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.event import AxisCondition, Event
from edge_service.messages.features import FeatureBlock
from edge_service.models.machine import Machine

from ...table import Table
from ..scores import Score, follow, pooled, score
from .production_cases import produced

PER_HOURS = 1000.0
TICK_BLOCKS = 10
START_NS = 1_700_000_000 * 10**9
FALSE = (AxisCondition.WARNING, AxisCondition.FAULT)


@dataclass(frozen=True, slots=True, eq=False)
class ShiftPart:
    """One shift with a new start of the estimator, and what a watch said of it."""

    plant: str
    axis_seed: int
    hours: float
    score: Score
    conditions: Counter[str]  # how often each condition began
    alarms: Counter[str]  # how often each kind was raised
    condition_s: Mapping[str, float]  # how long each condition stood


class Watched:
    """An estimator whose every interval and estimate goes to the health room as well."""

    def __init__(self, estimator: PreloadEstimator, machine: Machine) -> None:
        self._estimator = estimator
        geometry = ScrewGeometry(machine.transmission_ratio_m_per_rad, machine.axis.stroke_m)
        facts = (machine.axis.name, machine.fresh_preload_percent, geometry)
        self._watch = AxisMonitor(*facts, AlarmsConfig(), START_NS)
        self._sequence, self._now_ns = 0, START_NS
        self.conditions: Counter[str] = Counter()
        self.alarms: Counter[str] = Counter()
        self.condition_s: defaultdict[str, float] = defaultdict(float)
        self._condition = AxisCondition.UNAVAILABLE.value

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval; once for each `estimate`."""
        self._estimator.update(block)
        self._now_ns = START_NS + round(block.time_s * 1e9)
        self.condition_s[self._condition] += block.duration_s
        self._note(self._watch.on_feature(self._header(), block, self._now_ns))

    def estimate(self) -> PreloadEstimate:
        estimate = self._estimator.estimate()
        self._note(self._watch.on_preload(self._header(), estimate, self._now_ns))
        self._sequence += 1
        if self._sequence % TICK_BLOCKS == 0:
            self._note(self._watch.tick(self._now_ns))
            if self._watch.trend_is_due(self._now_ns):
                self._watch.take_trend(self._watch.trend_work()(), self._now_ns)
        return estimate

    def _header(self) -> Header:
        return Header(self._sequence, START_NS, self._now_ns, self._now_ns)

    def _note(self, events: Iterable[Event]) -> None:
        for event in events:
            if event.kind == "condition_changed":
                self._condition = AxisCondition(str(event.data["to"])).value
                self.conditions[self._condition] += 1
            elif event.kind == "alarm_raised":
                self.alarms[str(event.data["alarm"])] += 1


def shifts(plant: str, axis_seed: int, duration_s: float) -> Iterator[ShiftPart]:
    machine, recorded = produced(plant, axis_seed, duration_s)
    watched = Watched(MixturePreloadEstimator(machine), machine)
    found, hours = score(follow(watched, recorded)), duration_s / 3600.0
    said = (watched.conditions, watched.alarms, watched.condition_s)
    yield ShiftPart(plant, axis_seed, hours, found, *said)


def upper_bound(count: int, hours: float) -> float:
    """95 % upper bound of a rate per `PER_HOURS`, from a count that is Poisson.

    Without any event 3.0 / hours, the rule of three.
    """
    return float(chi2.ppf(0.95, 2 * count + 2)) / 2.0 / hours * PER_HOURS


def healthy_table(parts: Sequence[ShiftPart]) -> Table:
    plants = dict.fromkeys(part.plant for part in parts)
    rows = [_row(plant, [part for part in parts if part.plant == plant]) for plant in plants]
    seeds = [part.axis_seed for part in parts]
    return Table.of(
        [*rows, _row("all", parts)],
        f"axis seeds {min(seeds)} to {max(seeds)}; WARNING, FAULT: how often the condition became "
        "so; alarms: raised; at most so many of all three together per "
        f"{PER_HOURS:,.0f} axis-hours with 95 % confidence; min false: time in the conditions",
        *(_complaint(part) for part in parts if _said(part)),
    )


def _said(part: ShiftPart) -> Counter[str]:
    """Conditions and alarms that no healthy axis has."""
    return +(part.alarms + Counter({each.value: part.conditions[each.value] for each in FALSE}))


def _complaint(part: ShiftPart) -> str:
    """Line on what was said of one healthy axis."""
    each = ", ".join(f"{name} {n}" for name, n in _said(part).items())
    return f"  {part.plant} {part.axis_seed}: {each}"


def _row(title: str, parts: Sequence[ShiftPart]) -> Mapping[str, object]:
    hours = sum(part.hours for part in parts)
    together = pooled(part.score for part in parts)

    def stood_s(condition: AxisCondition) -> float:
        return sum(part.condition_s.get(condition.value, 0.0) for part in parts)

    return {
        "healthy production": title,
        "wrong": together.wrong,
        "rows": together.answered,
        "axes": len(parts),
        "hours": round(hours, 2),
        **{each.name: sum(part.conditions[each.value] for part in parts) for each in FALSE},
        "alarms": sum(part.alarms.total() for part in parts),
        "at most": upper_bound(sum(_said(part).total() for part in parts), hours),
        "min false": sum(map(stood_s, FALSE)) / 60.0,
        "unavailable": stood_s(AxisCondition.UNAVAILABLE) / 3600.0 / hours,
        "MAE": together.mae,
        "cover": together.coverage,
    }
