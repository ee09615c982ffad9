"""Status of the parts of the service, and who has fallen silent."""

from ..messages.estimate import PreloadEstimate
from ..messages.event import AxisCondition, Code, Event, told
from ..messages.health import ComponentHealth, ComponentStatus
from .axis_events import noted
from .inputs import NS_PER_S, Heard

DOWN = "tasks_down"
"""Reading of a component: how many of its tasks do not work."""
_LEVELS = {
    ComponentStatus.RECOVERABLE_ERROR: AxisCondition.WARNING,
    ComponentStatus.PERMANENT_ERROR: AxisCondition.FAULT,
}
_ENDED = (ComponentStatus.STOPPED, ComponentStatus.PERMANENT_ERROR)


def is_down(report: ComponentHealth) -> bool:
    """A component, or a task of it, does not work."""
    if report.status in (ComponentStatus.STOPPING, ComponentStatus.STOPPED):
        return False
    given_up = report.status is ComponentStatus.PERMANENT_ERROR
    return given_up or report.readings.get(DOWN, 0.0) > 0.0


class ComponentWatch:
    """Last reports of the components.

    A component that stopped reporting without having said `stopped` is in error: its process may
    be gone. Reports are therefore expected at the rate of the health topic.
    """

    def __init__(self, silent_after_s: float) -> None:
        self._silent_after_s = silent_after_s
        self._reports: dict[tuple[str, str | None], tuple[ComponentHealth, int]] = {}
        self._shown: dict[tuple[str, str | None], ComponentStatus] = {}

    def on_report(self, report: ComponentHealth, now_ns: int) -> tuple[Event, ...]:
        """Take a report in; events of what changed."""
        self._reports[report.component, report.axis] = (report, now_ns)
        return self.tick(now_ns)

    def forget(self, axis: str) -> None:
        self._reports = {key: each for key, each in self._reports.items() if key[1] != axis}

    def missing(self, preload: Heard[PreloadEstimate], axis: str, now_ns: int) -> str | None:
        """Reason why there is no current estimate of an axis; None if there is one."""
        if not preload.is_stale(now_ns):
            return None
        for report in self.reports(now_ns, axis):
            is_starting = report.status is ComponentStatus.STARTING and bool(report.reason)
            if report.component == "estimate" and is_starting:
                return f"preparing: {report.reason}"
        if preload.header is None:
            return "no_input: no preload estimate heard yet"
        return f"stale_input: no new preload estimate for more than {preload.stale_after_s:g} s"

    def tick(self, now_ns: int) -> tuple[Event, ...]:
        """Events of what changed up to now."""
        events = []
        for report in self.reports(now_ns):
            key = (report.component, report.axis)
            before = self._shown.get(key)
            if before is not report.status:
                self._shown[key] = report.status
                reason = f": {report.reason}" if report.reason else ""
                words = {"part": report.status.replace("_", " "), "reason": reason}
                values = {"component": report.component, "part": report.status.value}
                changed = told(Code.COMPONENT_CHANGED, words, **values)
                data = {"component": report.component, "from": before, "to": report.status}
                kind, level = "component_changed", _LEVELS.get(report.status, AxisCondition.NORMAL)
                events.append(noted(report.axis or "", kind, changed, now_ns, data, level))
        return tuple(events)

    def reports(self, now_ns: int, axis: str | None = "") -> tuple[ComponentHealth, ...]:
        """Present status of the components heard, in the order of first hearing.

        Args:
            axis: of this one alone; None: of those that serve all axes; empty: of all.
        """
        found = []
        for report, heard_ns in self._reports.values():
            if axis not in ("", report.axis):
                continue
            silent = abs(now_ns - heard_ns) > self._silent_after_s * NS_PER_S
            if silent and report.status not in _ENDED:
                reason = f"silent: no report for more than {self._silent_after_s:g} s"
                update = {"status": ComponentStatus.RECOVERABLE_ERROR, "reason": reason}
                found.append(report.model_copy(update=update))
            else:
                found.append(report)
        return tuple(found)
