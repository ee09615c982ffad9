"""While the estimator is being prepared, nobody is sent to the drive."""

import pytest

from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.limits import AlarmSettings
from edge_service.health.service_state import ServiceState
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.health import AxisHealth, ComponentHealth, ComponentStatus, Task

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
DRIVE = {Task.SWITCH_ON, Task.CHECK_CONNECTION}


class Start:
    """The first minutes of a service whose estimator says what it does once a second."""

    def __init__(self) -> None:
        self.state = ServiceState({"X": None}, START_NS)
        facts = ("X", 10.0, ScrewGeometry(0.003, 0.8))
        self.monitor = AxisMonitor(*facts, AlarmSettings(), START_NS)
        self.sequence = 0

    def at(self, second: int, status: ComponentStatus | None, reason: str = "") -> AxisHealth:
        """Answer after a report of the estimator, which may be missing."""
        now_ns = START_NS + second * NS
        if status is not None:
            report = ComponentHealth(component="estimate", axis="X", status=status, reason=reason)
            self.monitor.on_component(report, now_ns)
            self.state.on_component(report, now_ns)
        self.monitor.tick(now_ns)
        self.sequence += 1
        header = Header(self.sequence, START_NS, now_ns, now_ns)
        self.state.on_health(header, self.monitor.health(now_ns), now_ns)
        return self.state.health("X", now_ns)


def codes(health: AxisHealth) -> list[str]:
    return [reason.partition(":")[0] for reason in health.reasons]


@pytest.mark.parametrize("seconds", [1, 60, 119])
def test_preparing_is_the_only_reason_and_waiting_the_only_task(seconds: int) -> None:
    start = Start()
    for second in range(seconds):
        health = start.at(second, ComponentStatus.STARTING, "being prepared")
        assert codes(health) == ["preparing"]
        assert [each.task for each in health.advice] == [Task.WAIT]
        assert health.alarms == ()
    now_ns = START_NS + second * NS
    assert start.state.unready(now_ns) == ("X: preparing: being prepared",)
    assert start.state.preload("X", now_ns).reasons == ("preparing: being prepared",)


@pytest.mark.parametrize(
    "status", [None, *(each for each in ComponentStatus if each != ComponentStatus.STARTING)]
)
def test_an_estimator_that_is_ready_or_gone_hides_nothing(status: ComponentStatus | None) -> None:
    """Neither one that has fallen silent, nor one that failed, is being prepared."""
    start = Start()
    start.at(0, ComponentStatus.STARTING, "being prepared")
    for second in range(1, 60):
        health = start.at(second, status)
    assert "preparing" not in codes(health)
    assert {each.task for each in health.advice} & DRIVE
