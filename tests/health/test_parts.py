"""Parts of the service that do not work: alarm of the axes that rest on them, and not ready."""

import pytest

from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.limits import AlarmSettings
from edge_service.health.service_state import ServiceState
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.health import ComponentHealth, ComponentStatus

NS = 1_000_000_000
NOW_NS = 1_700_000_000 * NS


def report(axis: str | None, down: int, status: ComponentStatus) -> ComponentHealth:
    return ComponentHealth(
        component="estimate",
        axis=axis,
        status=status,
        reason="features ended (ValueError)" if down else "",
        readings={"tasks_down": float(down)},
    )


def monitor(axis: str) -> AxisMonitor:
    facts = (axis, 7.0, ScrewGeometry(0.003, 0.8))
    return AxisMonitor(*facts, AlarmSettings(), NOW_NS)


OK, DOWN, LOST = (
    ComponentStatus.OK,
    ComponentStatus.RECOVERABLE_ERROR,
    ComponentStatus.PERMANENT_ERROR,
)


@pytest.mark.parametrize(("axis", "concerns"), [(None, "XY"), ("X", "X"), ("Y", "Y")])
@pytest.mark.parametrize(("down", "status"), [(1, DOWN), (0, LOST)])
def test_a_part_that_is_down_calls_for_a_person_on_the_axes_that_rest_on_it(
    axis: str | None, concerns: str, down: int, status: ComponentStatus
) -> None:
    for name in "XY":
        axis_monitor = monitor(name)
        raised = axis_monitor.on_component(report(axis, down, status), NOW_NS)
        alarms = [event for event in raised if event.kind == "alarm_raised"]
        assert bool(alarms) is (name in concerns)
        assert all("Estimate does not work" in event.text for event in alarms)
        axis_monitor.on_component(report(axis, 0, OK), NOW_NS + NS)
        axis_monitor.tick(NOW_NS + 2 * NS)
        cleared = axis_monitor.tick(NOW_NS + 10 * NS)
        kinds = [event.kind for event in cleared]
        assert ("alarm_cleared" in kinds) is (name in concerns)


def test_a_machine_that_cannot_be_reached_is_no_fault_of_the_service() -> None:
    assert not [
        event
        for event in monitor("X").on_component(report("X", 0, DOWN), NOW_NS)
        if event.kind == "alarm_raised"
    ]


def test_a_service_with_a_part_down_is_not_ready_and_says_which() -> None:
    state = ServiceState({"X": None}, NOW_NS)
    state.on_component(report(None, 1, DOWN), NOW_NS)
    assert any("service: part_down: estimate: features" in each for each in state.unready(NOW_NS))
    state.on_component(report(None, 0, OK), NOW_NS)
    assert not any("part_down" in each for each in state.unready(NOW_NS))
