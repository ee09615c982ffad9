"""The last word on every axis, for whoever presents it: what may be read now, and nothing else."""

from collections import Counter
from collections.abc import Callable, Mapping

from ..messages.answer import AxisAnswer, PreloadAnswer, of_fresh
from ..messages.codec import Header
from ..messages.estimate import EstimateStatus, ImmEstimate, PreloadEstimate
from ..messages.event import AxisCondition, Event
from ..messages.features import FeatureBlock
from ..messages.health import AxisHealth, ComponentHealth, Limits
from ..messages.keys import MachineKeys
from ..messages.topics import FEAT, HEALTH, IMM, PRELOAD
from .components import ComponentWatch, is_down
from .condition import FIRST
from .inputs import NS_PER_S, Heard
from .live_features import LiveFeatures
from .statements import consistent
from .store.events import EventLog
from .store.history import History
from .store.readers import FanOut
from .store.store import Store
from .wear.trend import as_of

BACKLOG = 256
"""Events that may wait for one slow reader."""
_LATEST_NS = 3600 * NS_PER_S
"""Greatest age on arrival: what is older is of another clock, and no history of ours."""


class AxisState:
    """Last estimate and condition of one axis, and how old they are."""

    def __init__(self, axis: str, limits: Limits | None, components: ComponentWatch) -> None:
        self.axis, self.limits = axis, limits
        self._components = components
        self.preload = Heard[PreloadEstimate](PRELOAD.stale_after_s)
        self.health = Heard[AxisHealth](HEALTH.stale_after_s)
        self.imm = Heard[ImmEstimate](IMM.stale_after_s)

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Reasons why nothing current can be said; empty if it can."""
        heard, health = self.health, None
        if heard.header is None:
            health = "no_health: the condition was not heard yet"
        elif heard.is_stale(now_ns):
            health = f"stale_health: condition not renewed for more than {heard.stale_after_s:g} s"
        preload = self._components.missing(self.preload, self.axis, now_ns)
        return tuple(filter(None, (preload, health)))

    def readable(self, now_ns: int) -> PreloadEstimate:
        """The estimate without what must not be read now: none before the condition."""
        estimate = self.preload.payload
        missing = self._components.missing(self.preload, self.axis, now_ns)
        none = EstimateStatus.UNESTIMATED
        if estimate is None or missing is not None:
            reasons, time_s = tuple(filter(None, (missing,))), getattr(estimate, "time_s", 0.0)
            return PreloadEstimate(time_s=time_s, status=none, reasons=reasons)
        last, is_number = self.health.payload, estimate.status is EstimateStatus.ESTIMATED
        states = () if last is None else (last.condition, last.status)
        if is_number and (AxisCondition.UNAVAILABLE not in states or estimate.status in states):
            return estimate
        changes = {"status": none, "reasons": (FIRST,)} if is_number else {}
        kept = {"time_s", "status", "method", "reasons", "level", "data_used_s"}
        return PreloadEstimate(**{name: getattr(estimate, name) for name in kept} | changes)

    def opinion(self, now_ns: int) -> ImmEstimate:
        """The second opinion; without numbers where none may be read now."""
        last = self.imm.payload or ImmEstimate(axis=self.axis)
        if not self.imm.is_stale(now_ns):
            return last
        measured_ns = last.measured_time_ns
        return ImmEstimate(axis=self.axis, engine=last.engine, measured_time_ns=measured_ns)

    def answer(self, started_ns: int, now_ns: int) -> AxisAnswer:
        """All that may be read of the axis now."""
        return AxisAnswer(
            axis=self.axis,
            estimate=self.readable(now_ns),
            measured_ns=self.preload.measured_ns(now_ns),
            health=self.told(started_ns, now_ns),
            is_heard=not self.missing(now_ns),
            header=self.preload.header,
            opinion=self.opinion(now_ns),
        )

    def told(self, started_ns: int, now_ns: int) -> AxisHealth:
        """Condition of the axis now; UNAVAILABLE as soon as it rests on something stale."""
        unavailable = AxisCondition.UNAVAILABLE
        last = self.health.payload or AxisHealth(
            axis=self.axis, condition=unavailable, since_time_ns=started_ns
        )
        estimate, limits = self.readable(now_ns), self.limits or last.limits
        changes: dict[str, object] = {
            "status": estimate.status,
            "method": estimate.method,
            "measured_time_ns": self.preload.measured_ns(now_ns),
            "limits": limits,
            "trend": last.trend and as_of(last.trend, now_ns),
            "components": self._components.reports(now_ns, self.axis) or last.components,
        }
        missing = self.missing(now_ns)
        is_known = last.condition is not unavailable and not missing
        fresh = None if limits is None or not is_known else limits.fresh_percent
        changes["of_fresh"] = of_fresh(estimate, fresh)
        if FIRST in estimate.reasons:
            changes["reasons"] = (FIRST,)
        if missing:
            own = last.reasons if last.condition is unavailable else ()
            changes["reasons"] = tuple(dict.fromkeys((*missing, *own)))
        if missing and last.condition is not unavailable:
            stale = [each for each in (self.preload, self.health) if each.is_stale(now_ns)]
            since_ns = max(min(each.stale_since_ns for each in stale), started_ns)
            changes |= {"condition": unavailable, "since_time_ns": since_ns}
        return consistent(last.model_copy(update=changes), estimate)


class ServiceState:
    """Last values, history and events of the axes.

    Payloads of other axes are ignored and counted, so nobody on the bus can make it grow. It may
    be used from the thread of one event loop only.

    Args:
        axes: The configured axes with their limits (for display only), in the order of display.
        events, history: in the store; in memory without.
        refused: Payloads refused on the bus so far, by topic and reason.
    """

    def __init__(
        self,
        axes: Mapping[str, Limits | None],
        now_ns: int,
        events: EventLog | None = None,
        history: History | None = None,
        kept: str = "in memory only: it ends with the service",
        place: MachineKeys | None = None,
        refused: Callable[[], Counter[tuple[str, str]]] = Counter,
        configuration: str = "",
    ) -> None:
        self._started_ns = now_ns
        self.place = place or MachineKeys("", "")
        self.refused = refused
        self.configuration = configuration
        self.kept = kept
        self._components = ComponentWatch(HEALTH.stale_after_s)
        self._axes = {axis: AxisState(axis, each, self._components) for axis, each in axes.items()}
        self._live = {axis: LiveFeatures(None) for axis in axes}
        self._versions: Counter[tuple[str, str]] = Counter()
        self.events = events or EventLog(Store(None))
        self.history = history or History(self.events.store)
        self.readers = FanOut(BACKLOG)
        self.ignored_payloads = 0

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self._axes)

    def on_preload(self, axis: str, header: Header, estimate: PreloadEstimate, now_ns: int) -> None:
        if self._knows(axis):
            self._axes[axis].preload.hear(header, estimate, now_ns)
            if now_ns - header.source_time_ns < _LATEST_NS:
                temperature_c = self._live[axis].temperature_c
                self.history.append(axis, header.source_time_ns, estimate, temperature_c)
            self._mark(PRELOAD.name, axis)

    def on_opinion(self, axis: str, header: Header, opinion: ImmEstimate, now_ns: int) -> None:
        if self._knows(axis):
            self._axes[axis].imm.hear(header, opinion, now_ns)

    def on_feature(self, axis: str, header: Header, block: FeatureBlock) -> None:
        """Take an interval in, for the live traces."""
        if self._knows(axis):
            self._live[axis].add(header.source_time_ns, block)
            self._mark(FEAT.name, axis)

    def on_health(self, header: Header, health: AxisHealth, now_ns: int) -> None:
        if self._knows(health.axis):
            self._axes[health.axis].health.hear(header, health, now_ns)
            self._mark(HEALTH.name, health.axis)

    def concerns(self, event: Event) -> bool:
        """An event is of the service or of one of its axes."""
        return not event.axis or self._knows(event.axis)

    def on_component(self, report: ComponentHealth, now_ns: int) -> None:
        if report.axis is None or self._knows(report.axis):
            self._components.on_report(report, now_ns)

    def answer(self, axis: str, now_ns: int) -> AxisAnswer:
        """All that may be read of an axis now; KeyError for an unknown axis."""
        return self._axes[axis].answer(self._started_ns, now_ns)

    def preload(self, axis: str, now_ns: int) -> PreloadAnswer:
        """Preload of an axis as it may be shown now; KeyError for an unknown axis."""
        age_s = self._axes[axis].preload.age_s(now_ns)
        return self.answer(axis, now_ns).preload(age_s)

    def health(self, axis: str, now_ns: int) -> AxisHealth:
        """Condition of an axis now; UNAVAILABLE as soon as it rests on something stale."""
        return self._axes[axis].told(self._started_ns, now_ns)

    def components(self, now_ns: int, axis: str | None = "") -> tuple[ComponentHealth, ...]:
        """Components of all axes, those of one, or (None) those that serve all."""
        return self._components.reports(now_ns, axis)

    def renew(self, axis: str, limits: Limits | None, ratio_m_per_rad: float | None) -> None:
        """Show an axis by another machine file from now on, or a new axis."""
        if axis not in self._axes:
            self._axes[axis] = AxisState(axis, limits, self._components)
        self._axes[axis].limits = limits
        self._live[axis] = LiveFeatures(ratio_m_per_rad)

    def drop(self, axis: str) -> None:
        """Show an axis no longer."""
        del self._axes[axis], self._live[axis]
        self._components.forget(axis)

    def live(self, axis: str) -> LiveFeatures:
        """Last intervals of an axis, and the state of its channels."""
        return self._live[axis]

    def version(self, topic: str, axis: str) -> int:
        """A number that changes with every payload of a topic."""
        return self._versions[topic, axis]

    def unready(self, now_ns: int) -> tuple[str, ...]:
        """Reasons why the service cannot answer for every axis; empty if it can."""
        if not self._axes:
            return ("no_axis: no axis is configured",)
        reasons = []
        for axis, state in self._axes.items():
            reasons += [f"{axis}: {reason}" for reason in state.missing(now_ns)]
        for report in self._components.reports(now_ns):
            if is_down(report):
                who = report.axis or "service"
                reasons.append(f"{who}: part_down: {report.component}: {report.reason}")
        return tuple(reasons)

    def _mark(self, topic: str, axis: str) -> None:
        self._versions[topic, axis] += 1
        self.readers.mark(topic, axis)

    def _knows(self, axis: str) -> bool:
        self.ignored_payloads += axis not in self._axes
        return axis in self._axes
