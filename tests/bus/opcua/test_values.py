"""What is not known is shown by OPC UA as null with a bad status, and nothing else is."""

import pytest
from asyncua.ua.status_codes import StatusCodes

from edge_service.bus.opcua.values import FIELDS, HEALTH, data_values
from edge_service.health.advice.headline import headline
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Severity
from edge_service.messages.health import AxisCondition

from ...messages.answers import SILENT, answer, health_of

NUMBERS = ("Preload", "PreloadLow", "PreloadHigh", "PreloadLevel")


def test_a_number_is_percent_of_fresh_with_its_interval_and_time() -> None:
    values = data_values(answer(preload_percent=3.0, low=2.5, high=4.0, fresh_percent=5.0))
    assert [values[name].Value.Value for name in NUMBERS] == pytest.approx([60, 50, 80, 0.95])
    for name in NUMBERS:
        assert values[name].StatusCode.is_good()
        assert values[name].SourceTimestamp.timestamp() == pytest.approx(1_790_000_000.0)


@pytest.mark.parametrize("status", [s for s in EstimateStatus if s is not EstimateStatus.ESTIMATED])
def test_without_a_number_each_is_null_and_bad(status: EstimateStatus) -> None:
    values = data_values(answer(estimate=PreloadEstimate(time_s=1.0, status=status)))
    for name in NUMBERS:
        assert values[name].Value.Value is None
        assert values[name].StatusCode.is_bad()
    assert values["EstimateStatus"].Value.Value == status.value


def test_without_the_fresh_preload_there_is_no_percent_of_it() -> None:
    values = data_values(answer(fresh_percent=None))
    assert values["Preload"].Value.Value is None
    assert values["Preload"].StatusCode.is_bad()


def test_of_a_silent_service_all_that_may_be_missing_says_that_nothing_comes() -> None:
    values = data_values(SILENT)
    for name in (*NUMBERS, HEALTH):
        assert values[name].StatusCode.value == StatusCodes.BadNoCommunication
    assert values["Condition"].Value.Value == "UNAVAILABLE"


@pytest.mark.parametrize("condition", AxisCondition)
@pytest.mark.parametrize("alarm", [None, *AlarmKind])
def test_every_headline_has_its_device_health(
    condition: AxisCondition, alarm: AlarmKind | None
) -> None:
    """NORMAL only where nothing is wrong, a null only where nothing is known."""
    alarms = [] if alarm is None else [alarm]
    raised = tuple(
        Alarm(kind=kind, severity=Severity.WARNING, active=True, message="m", raised_time_ns=1)
        for kind in alarms
    )
    health = health_of(condition, alarms=raised)
    shown = data_values(answer(health=health))[HEALTH]
    code = headline(health).code
    if code == "unavailable":
        assert shown.StatusCode.is_bad()
    else:
        assert shown.StatusCode.is_good()
        assert (shown.Value.Value == 0) == (code == "normal")
    if condition is AxisCondition.FAULT:
        assert shown.Value.Value == 1


def test_every_variable_has_a_value_or_a_bad_status() -> None:
    for said in (answer(), SILENT):
        values = data_values(said)
        assert values.keys() == FIELDS.keys()
        for value in values.values():
            assert (value.Value.Value is None) == value.StatusCode.is_bad()
