"""From notifications to rows: times, held values, quality. No server."""

import math

import pytest
from asyncua.ua.status_codes import StatusCodes

from drivers.opcua.driver import Change, RowMaker
from drivers.opcua.variables import UNIT_OF_ID, NodeConfig, node_id
from drivers.signals import Scaling
from edge_service.messages.samples import ANGLE, TEMPERATURE, TORQUE, Quality

from ..bench import MACHINE

START_S = 1.7e9


def maker(stale_after_s: float = math.inf) -> RowMaker:
    scalings = {
        name: Scaling.of(NodeConfig(channel=name, node="ns=2;i=1"), MACHINE, "signals[0]")
        for name in (TORQUE, ANGLE, TEMPERATURE)
    }
    return RowMaker(scalings, 0.05, stale_after_s)


def change(channel: str | None, value: object, at_s: float | None, status: int = 0) -> Change:
    source_s = None if at_s is None else START_S + at_s
    return Change(channel, value, status, source_s, None)


def test_changes_sampled_together_are_one_row_at_the_source_time() -> None:
    rows = maker().rows([change(TORQUE, 0.5, 0.0), change(ANGLE, 2.0, 0.001)], START_S + 9.0)
    ((time_s, values),) = rows
    assert time_s == START_S
    assert values[TORQUE] == (0.5, Quality.GOOD)
    assert values[ANGLE] == (2.0, Quality.GOOD)
    assert values[TEMPERATURE][1] is Quality.NO_VALUE


def test_a_queue_of_values_becomes_rows_in_order() -> None:
    changes = [
        change(ANGLE, 3.0, 0.3),
        change(ANGLE, 1.0, 0.1),
        change(TORQUE, 0.1, 0.1),
        change(ANGLE, 2.0, 0.2),
    ]
    rows = maker().rows(changes, START_S + 1.0)
    assert [time_s - START_S for time_s, _ in rows] == pytest.approx([0.1, 0.2, 0.3])
    assert [values[ANGLE][0] for _, values in rows] == [1.0, 2.0, 3.0]
    assert [values[TORQUE][0] for _, values in rows] == [0.1, 0.1, 0.1]


@pytest.mark.parametrize(
    ("status", "quality"),
    [
        (StatusCodes.Good, Quality.GOOD),
        (StatusCodes.GoodClamped, Quality.GOOD),
        (StatusCodes.Good | 0x480, Quality.OVERFLOW),
        (StatusCodes.Uncertain, Quality.SOURCE_UNCERTAIN),
        (StatusCodes.UncertainLastUsableValue, Quality.SOURCE_UNCERTAIN),
        (StatusCodes.Bad, Quality.SOURCE_BAD),
        (StatusCodes.BadSensorFailure, Quality.SOURCE_BAD),
        (0xC0000000, Quality.SOURCE_BAD),
    ],
)
def test_status_codes_become_quality(status: int, quality: Quality) -> None:
    ((_, values),) = maker().rows([change(TORQUE, 0.5, 0.0, status)], START_S)
    value, found = values[TORQUE]
    assert found is quality
    assert math.isnan(value) == (quality is Quality.SOURCE_BAD)


def test_a_value_without_a_source_time_gets_that_of_its_arrival_and_a_doubt() -> None:
    ((time_s, values),) = maker().rows([change(TORQUE, 0.5, None)], START_S + 4.0)
    assert time_s == START_S + 4.0
    assert values[TORQUE] == (0.5, Quality.NO_SOURCE_TIME)
    server = Change(TORQUE, 0.5, 0, None, START_S + 2.0)
    ((time_s, values),) = maker().rows([server], START_S + 4.0)
    assert time_s == START_S + 2.0


def test_a_sign_of_life_stands_for_unchanged_values() -> None:
    rows = maker()
    assert rows.unchanged(START_S, 0.1) == []
    rows.rows([change(TORQUE, 0.5, 0.0)], START_S + 0.02)
    ((time_s, values),) = rows.unchanged(START_S + 1.02, 0.1)
    assert time_s == pytest.approx(START_S + 0.9)
    assert values[TORQUE] == (0.5, Quality.GOOD)
    ((time_s, _),) = rows.unchanged(START_S + 2.02, 0.1)
    assert time_s == pytest.approx(START_S + 1.9, abs=0.11)
    ((later_s, _),) = rows.rows([change(TORQUE, 0.6, 2.0)], START_S + 2.02)
    assert later_s > time_s


def test_a_heartbeat_that_rests_makes_everything_stale() -> None:
    rows = maker(stale_after_s=0.5)
    rows.rows([change(None, 1, 0.0), change(TORQUE, 0.5, 0.0)], START_S)
    ((_, fresh),) = rows.rows([change(TORQUE, 0.6, 0.4)], START_S + 0.4)
    assert fresh[TORQUE] == (0.6, Quality.GOOD)
    ((_, stale),) = rows.rows([change(TORQUE, 0.7, 0.6)], START_S + 0.6)
    assert {code for _, code in stale.values()} == {Quality.STALE}
    rows.rows([change(None, 2, 0.7)], START_S + 0.7)
    ((_, again),) = rows.rows([change(TORQUE, 0.8, 0.8)], START_S + 0.8)
    assert again[TORQUE] == (0.8, Quality.GOOD)


NAMESPACES = ["http://opcfoundation.org/UA/", "urn:app", "http://a/b/"]


def test_node_ids_by_index_and_by_namespace() -> None:
    assert node_id("nsu=http://a/b/;s=X.torque", NAMESPACES) == node_id("ns=2;s=X.torque", [])
    assert node_id("ns=2;i=77", []).Identifier == 77


@pytest.mark.parametrize(
    ("unit", "number"),  # OPC 10000-8, 5.6.3 and the OPC Foundation's UNECE_to_OPCUA.csv
    [("mm", 5066068), ("m", 5067858), ("degC", 4408652), ("rad", 4405297), ("N", 5129559)],
)
def test_unit_ids_are_those_of_the_specification(unit: str, number: int) -> None:
    assert UNIT_OF_ID[number] == unit
