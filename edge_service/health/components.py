"""Status of the parts of the service, who has fallen silent, and payloads refused on the bus."""

from collections import Counter
from collections.abc import Mapping

from ..messages.event import AxisCondition, Event
from ..messages.health import ComponentHealth, ComponentStatus
from .inputs import NS_PER_S

LEGAL_TRANSITIONS: Mapping[ComponentStatus, frozenset[ComponentStatus]] = {
    ComponentStatus.STARTING: frozenset(
        {
            ComponentStatus.OK,
            ComponentStatus.RECOVERABLE_ERROR,
            ComponentStatus.PERMANENT_ERROR,
            ComponentStatus.STOPPING,
        }
    ),
    ComponentStatus.OK: frozenset(
        {
            ComponentStatus.RECOVERABLE_ERROR,
            ComponentStatus.PERMANENT_ERROR,
            ComponentStatus.STOPPING,
        }
    ),
    ComponentStatus.RECOVERABLE_ERROR: frozenset(
        {ComponentStatus.OK, ComponentStatus.PERMANENT_ERROR, ComponentStatus.STOPPING}
    ),
    ComponentStatus.PERMANENT_ERROR: frozenset({ComponentStatus.STOPPING}),
    ComponentStatus.STOPPING: frozenset({ComponentStatus.STOPPED}),
    ComponentStatus.STOPPED: frozenset(),
}
"""From -> to, after the component status of the OpenTelemetry Collector."""

_SEVERITY = {
    ComponentStatus.RECOVERABLE_ERROR: AxisCondition.WARNING,
    ComponentStatus.PERMANENT_ERROR: AxisCondition.FAULT,
}


class IllegalTransitionError(Exception):
    """A component claimed a status that cannot follow its present one."""


class ComponentStatusMachine:
    """Status of one component, as the component itself keeps it."""

    def __init__(self, component: str, axis: str | None = None) -> None:
        self.component = component
        self.axis = axis
        self.status = ComponentStatus.STARTING
        self.reason = ""

    def to(self, status: ComponentStatus, reason: str = "") -> bool:
        """Enter `status`; True if it is a new one. The same status only renews the reason."""
        changed = status is not self.status
        if changed and status not in LEGAL_TRANSITIONS[self.status]:
            raise IllegalTransitionError(f"{self.component}: no way from {self.status} to {status}")
        self.status = status
        self.reason = reason
        return changed

    def report(
        self,
        counters: Mapping[str, int] | None = None,
        readings: Mapping[str, float] | None = None,
    ) -> ComponentHealth:
        """Report of the component about itself."""
        return ComponentHealth(
            component=self.component,
            axis=self.axis,
            status=self.status,
            reason=self.reason,
            counters=dict(counters or {}),
            readings=dict(readings or {}),
        )


class ComponentWatch:
    """Last reports of several components, with an event for each change of status.

    A component that stopped reporting without having said `stopped` is in error: its process may
    be gone. Reports are therefore expected at the rate of the health topic.
    """

    def __init__(self, silent_after_s: float | None) -> None:
        self._silent_after_ns = None if silent_after_s is None else round(silent_after_s * NS_PER_S)
        self._reports: dict[tuple[str, str | None], tuple[ComponentHealth, int]] = {}
        self._shown: dict[tuple[str, str | None], ComponentStatus] = {}

    def on_report(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a report in; events of what changed."""
        self._reports[report.component, report.axis] = (report, now_ns)
        return self.tick(now_ns)

    def forget(self, axis: str) -> None:
        """Forget the components of an axis."""
        self._reports = {key: each for key, each in self._reports.items() if key[1] != axis}

    def preparing(self, axis: str, now_ns: int) -> str | None:
        """Reason why the estimator of an axis cannot answer yet; None once it could."""
        for report in self.reports(now_ns):
            if (report.component, report.axis) == ("estimate", axis):
                starting = report.status is ComponentStatus.STARTING and report.reason
                return f"preparing: {report.reason}" if starting else None
        return None

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Events of what changed up to now."""
        events = []
        for report in self.reports(now_ns):
            key = (report.component, report.axis)
            before = self._shown.get(key)
            if before is not report.status:
                self._shown[key] = report.status
                events.append(_component_changed(report, before, now_ns))
        return tuple(events)

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._reports = {
            key: (report, heard_ns + step_ns) for key, (report, heard_ns) in self._reports.items()
        }

    def reports(self, now_ns: int) -> tuple[ComponentHealth, ...]:
        """Present status of every component heard, in the order of first hearing."""
        return tuple(
            self._present(report, heard_ns, now_ns) for report, heard_ns in self._reports.values()
        )

    def _present(self, report: ComponentHealth, heard_ns: int, now_ns: int) -> ComponentHealth:
        limit_ns = self._silent_after_ns
        ended = report.status in (ComponentStatus.STOPPED, ComponentStatus.PERMANENT_ERROR)
        if limit_ns is None or ended or abs(now_ns - heard_ns) <= limit_ns:
            return report
        silence = f"silent: no report for more than {limit_ns / NS_PER_S:g} s"
        return report.model_copy(
            update={"status": ComponentStatus.RECOVERABLE_ERROR, "reason": silence}
        )


def _component_changed(
    report: ComponentHealth, before: ComponentStatus | None, now_ns: int
) -> Event:
    return Event(
        axis=report.axis or "",
        kind="component_changed",
        level=_SEVERITY.get(report.status, AxisCondition.NORMAL),
        text=f"{report.component} is {report.status.replace('_', ' ')}"
        + (f": {report.reason}" if report.reason else ""),
        time_ns=now_ns,
        data={"component": report.component, "from": before, "to": report.status},
    )


Refused = Counter[tuple[str, str]]
"""Counts by key and reason."""
_QUIET_S = 600
_MOST_TOLD = 4


class RefusalWatch:
    """Tells of refusals, key by key: at once when they begin, then every ten minutes at most.

    Overtaken payloads are no sign of anything: they are counted, not told.
    """

    def __init__(self) -> None:
        self._seen: Counter[str] = Counter()
        self._told_ns: dict[str, int] = {}

    def tick(self, refused: Refused, now_ns: int) -> tuple[Event, ...]:
        """Events of what was refused since they were last told."""
        news = [key for key, count in _by_key(refused).items() if count > self._seen[key]]
        due = [key for key in news if self._is_due(key, now_ns)][:_MOST_TOLD]
        return tuple(self._tell(key, refused, now_ns) for key in due)

    def _is_due(self, key: str, now_ns: int) -> bool:
        told_ns = self._told_ns.get(key)
        return told_ns is None or abs(now_ns - told_ns) >= _QUIET_S * NS_PER_S

    def _tell(self, key: str, refused: Refused, now_ns: int) -> Event:
        reasons = {reason: count for (each, reason), count in refused.items() if each == key}
        total = sum(count for reason, count in reasons.items() if reason != "late")
        new = total - self._seen[key]
        self._seen[key], self._told_ns[key] = total, now_ns
        words = ", ".join(reason.replace("_", " ") for reason in sorted(reasons))
        return Event(
            axis="",
            kind="component_changed",
            level=AxisCondition.WARNING,
            text=f"{new} payloads on {key} were refused ({words}): who sends them?",
            time_ns=now_ns,
            data={"key": key, "refused": new},
        )


def _by_key(refused: Refused) -> Counter[str]:
    counts: Counter[str] = Counter()
    for (key, reason), count in refused.items():
        if reason != "late":
            counts[key] += count
    return counts
