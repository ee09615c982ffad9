"""Parts of the service that do not work, or do not work yet: alarms, reasons, and not ready."""

import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.service_state import ServiceState
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.messages.health import AxisHealth, ComponentHealth, ComponentStatus, Task

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
OK, STARTING = ComponentStatus.OK, ComponentStatus.STARTING
DOWN, LOST = ComponentStatus.RECOVERABLE_ERROR, ComponentStatus.PERMANENT_ERROR
DRIVE = {Task.SWITCH_ON, Task.CHECK_CONNECTION}


def report(axis: str | None, status: ComponentStatus, reason: str, down: int) -> ComponentHealth:
    return ComponentHealth(
        component="estimate",
        axis=axis,
        status=status,
        reason=reason,
        readings={"tasks_down": float(down)},
    )


def monitor(axis: str) -> AxisMonitor:
    return AxisMonitor(axis, 7.0, ScrewGeometry(0.003, 0.8), AlarmsConfig(), START_NS)


@pytest.mark.parametrize(("axis", "concerns"), [(None, "XY"), ("X", "X"), ("Y", "Y")])
@pytest.mark.parametrize(("down", "status"), [(1, DOWN), (0, LOST)])
def test_a_part_that_is_down_calls_for_a_person_on_the_axes_that_rest_on_it(
    axis: str | None, concerns: str, down: int, status: ComponentStatus
) -> None:
    for name in "XY":
        watch = monitor(name)
        raised = watch.on_component(report(axis, status, "features ended", down), START_NS)
        alarms = [event.text for event in raised if event.kind == "alarm_raised"]
        assert alarms == ["Estimate does not work: features ended."] * (name in concerns)
        watch.on_component(report(axis, OK, "", 0), START_NS + NS)
        watch.tick(START_NS + 2 * NS)
        cleared = [event.kind for event in watch.tick(START_NS + 10 * NS)]
        assert ("alarm_cleared" in cleared) is (name in concerns)


def test_a_machine_that_cannot_be_reached_is_no_fault_of_the_service() -> None:
    told = monitor("X").on_component(report("X", DOWN, "no route", 0), START_NS)
    assert "alarm_raised" not in [event.kind for event in told]


def test_a_change_of_a_part_is_a_statement() -> None:
    changed, *_ = monitor("X").on_component(report("X", DOWN, "no route", 0), START_NS)
    assert changed.code == "component_changed"
    assert changed.values == {"component": "estimate", "part": "recoverable_error"}
    assert changed.text == "estimate is recoverable error: no route"


def test_a_service_with_a_part_down_is_not_ready_and_says_which() -> None:
    state = ServiceState({"X": None}, START_NS)
    state.on_component(report(None, DOWN, "features ended", 1), START_NS)
    assert "service: part_down: estimate: features ended" in state.unready(START_NS)
    state.on_component(report(None, OK, "", 0), START_NS)
    assert not any("part_down" in each for each in state.unready(START_NS))


class Start:
    """The first minutes of a service whose estimator says what it does once a second."""

    def __init__(self) -> None:
        self.state, self.monitor = ServiceState({"X": None}, START_NS), monitor("X")

    def at(self, second: int, status: ComponentStatus | None, reason: str = "") -> AxisHealth:
        """Answer after a report of the estimator, which may be missing."""
        now_ns = START_NS + second * NS
        if status is not None:
            told = report("X", status, reason, 0)
            self.monitor.on_component(told, now_ns)
            self.state.on_component(told, now_ns)
        self.monitor.tick(now_ns)
        header = Header(second, START_NS, now_ns, now_ns)
        self.state.on_health(header, self.monitor.health(now_ns), now_ns)
        return self.state.health("X", now_ns)


def codes(health: AxisHealth) -> list[str]:
    return [reason.partition(":")[0] for reason in health.reasons]


def test_preparing_is_the_only_reason_and_waiting_the_only_task() -> None:
    start = Start()
    for second in range(119):
        health = start.at(second, STARTING, "being prepared")
        assert codes(health) == ["preparing"]
        assert [each.task for each in health.advice] == [Task.WAIT]
        assert health.alarms == ()
    now_ns = START_NS + second * NS
    assert start.state.unready(now_ns) == ("X: preparing: being prepared",)
    assert start.state.preload("X", now_ns).reasons == ("preparing: being prepared",)


@pytest.mark.parametrize("status", [None, *(e for e in ComponentStatus if e is not STARTING)])
def test_an_estimator_that_is_ready_or_gone_hides_nothing(status: ComponentStatus | None) -> None:
    """Neither one that has fallen silent, nor one that failed, is being prepared."""
    start = Start()
    start.at(0, STARTING, "being prepared")
    for second in range(1, 60):
        health = start.at(second, status)
    assert "preparing" not in codes(health)
    assert {each.task for each in health.advice} & DRIVE
