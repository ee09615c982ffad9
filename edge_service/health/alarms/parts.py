"""Parts of the service that do not work, as they themselves report."""

from ...messages.health import ComponentHealth, ComponentStatus
from ...messages.sentence import Code, Told, told
from .words import SILENT

DOWN = "tasks_down"
"""Reading of a component: how many of its tasks do not work."""


class Parts:
    """The parts that an axis rests on."""

    def __init__(self) -> None:
        self._down: dict[tuple[str, str | None], Told] = {}

    def on_component(self, report: ComponentHealth) -> bool:
        """Take a report in; True if it changes what is down."""
        key = (report.component, report.axis)
        before = self._down.get(key)
        if is_down(report):
            self._down[key] = _down_words(report)
        elif report.status is not ComponentStatus.STARTING:
            self._down.pop(key, None)
        return (before is None) is (key in self._down)

    def cause(self) -> tuple[bool, Told]:
        """True if a part is down, with the first of them in words."""
        return bool(self._down), next(iter(self._down.values()), SILENT)


def _down_words(report: ComponentHealth) -> Told:
    """A part that does not work; its own words for the reason are in English alone."""
    words = {"component": report.component, "reason": report.reason}
    return told(Code.PART_DOWN, words, component=report.component.removesuffix("_process"))


def is_down(report: ComponentHealth) -> bool:
    """Tell whether a component, or a task of it, does not work."""
    if report.status in (ComponentStatus.STOPPING, ComponentStatus.STOPPED):
        return False
    given_up = report.status is ComponentStatus.PERMANENT_ERROR
    return given_up or report.readings.get(DOWN, 0.0) > 0.0
