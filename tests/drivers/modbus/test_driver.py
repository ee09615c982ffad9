"""The driver against its stub over a real socket: values, times, groups, faults, recovery."""

from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest

from drivers.base import DriverUnavailableError
from drivers.modbus.driver import ModbusDriver, PollGroup
from drivers.stub import Fault, FaultKind
from edge_service.messages.samples import (
    ANGLE,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    Quality,
    SampleFrame,
)

from ..bench import CONTEXT, free_port, samples_of, take, truth, whole
from .bench import REGISTERS, config_of, stub_of


class Rig:
    def __init__(self, **changes: Any) -> None:
        self.config = config_of(free_port(), **changes)
        self.stub = stub_of(self.config)
        self.driver = ModbusDriver(self.config, CONTEXT)

    async def rows(self, count: int) -> SampleFrame:
        """The next rows of an open driver as one frame."""
        return whole(await take(self.driver, count, samples_of))


@pytest.fixture
async def rig(request: pytest.FixtureRequest) -> AsyncIterator[Rig]:
    made = Rig(**getattr(request, "param", {}))
    await made.stub.start()
    await made.driver.open()
    yield made
    await made.driver.close()
    await made.stub.close()


@pytest.mark.parametrize("rig", [{"poll_groups": {"fast": 0.05}}], indirect=True)
async def test_values_are_those_of_the_source(rig: Rig) -> None:
    """Other work may make reads late; nothing else is found wrong with them."""
    rows = await rig.rows(20)
    numbers = np.rint((rows.channels[TORQUE] - 0.25) / 0.001).astype(int)
    assert len(set(numbers)) > 5
    heard = (rows.channels[channel] for channel in (TORQUE, ANGLE, TABLE_POSITION))
    for number, torque, angle, table in zip(numbers, *heard, strict=True):
        expected = truth(number)
        assert torque == pytest.approx(expected[TORQUE], rel=1e-6)
        assert angle % 50.0 == expected[ANGLE] % 50.0
        assert table == pytest.approx(1e-5 * angle / 0.5, abs=1e-6)
    np.testing.assert_allclose(rows.channels[TEMPERATURE], 21.5)
    codes = np.array([*rows.quality.values()])
    assert set(codes.flat) <= {Quality.GOOD, Quality.LATE_READ}
    assert (codes == Quality.GOOD).all(axis=0).sum() > 5


def test_polls_stay_on_their_grid_however_late_each_one_is() -> None:
    group = PollGroup(0.01, (), 5.0)
    generator = np.random.default_rng(1)
    missed = 0
    for _ in range(1000):
        missed += group.step(group.due_s + generator.uniform(0.0, 0.035))
    assert group.due_s == pytest.approx(5.0 + 0.01 * (1000 + missed), abs=1e-9)
    assert missed > 1000


SLOW = [each | ({"group": "slow"} if each.get("table") else {}) for each in REGISTERS]
GROUPS = {"poll_groups": {"fast": 0.01, "slow": 0.05}, "registers": SLOW}


@pytest.mark.parametrize("rig", [GROUPS], indirect=True)
async def test_a_slow_group_speaks_only_when_it_is_due(rig: Rig) -> None:
    rows = await rig.rows(40)
    heard = np.flatnonzero(np.isfinite(rows.channels[TEMPERATURE]))
    assert np.isfinite(rows.channels[TORQUE]).all()
    assert 6 <= len(heard) <= (rows.time_s[-1] - rows.time_s[0]) / 0.05 + 2
    assert not rows.quality[TEMPERATURE].any()


@pytest.mark.parametrize("code", [2, 4, 6])
async def test_a_device_that_answers_exceptions_is_asked_on(rig: Rig, code: int) -> None:
    rig.stub.fault = Fault(FaultKind.EXCEPTION, code)
    rows = await rig.rows(60)  # 0.6 s, twice the time after which a silent device is lost
    assert (rows.quality[TORQUE] == Quality.DEVICE_EXCEPTION).all()
    assert np.isnan(rows.channels[TORQUE]).all()
    rig.stub.fault = Fault()
    rows = await rig.rows(3)
    assert np.isfinite(rows.channels[TORQUE][1:]).all()
    assert rig.driver.counters["connections"] == 1


async def test_old_values_are_found_by_their_heartbeat(rig: Rig) -> None:
    await rig.rows(3)
    rig.stub.fault = Fault(FaultKind.STALE)
    rows = await rig.rows(130)
    assert (rows.quality[TORQUE][-10:] == Quality.STALE).all()
    assert np.isnan(rows.channels[TORQUE][-10:]).all()


async def test_a_late_answer_leaves_the_value_and_doubts_its_time(rig: Rig) -> None:
    rig.stub.fault = Fault(FaultKind.DELAY, 0.03)
    rows = await rig.rows(4)
    assert (rows.quality[TORQUE] == Quality.LATE_READ).all()
    assert np.isfinite(rows.channels[TORQUE]).all()
    assert rig.driver.counters["missed_polls"] > 0
    assert rig.driver.readings["poll_s"] > 0.03


async def test_a_device_that_hangs_is_lost_in_time_and_found_again(rig: Rig) -> None:
    await rig.rows(2)
    rig.stub.fault = Fault(FaultKind.HANG)
    with pytest.raises(DriverUnavailableError, match=r"no valid reply for .* s \(no reply\)"):
        await rig.rows(1000)
    with pytest.raises(DriverUnavailableError, match="no reply"):
        await rig.driver.open()
    rig.stub.fault = Fault()
    await rig.driver.open()
    assert np.isfinite((await rig.rows(2)).channels[TORQUE]).all()


ODD = [
    {"channel": TORQUE, "address": 100, "type": "int32", "unit": "mN m", "scale": -0.01}
    | {"word_order": "little"},
    {"channel": ANGLE, "address": 103, "type": "float64", "unit": "mm", "offset": 7.0},
    {"channel": TABLE_POSITION, "address": 200, "type": "float32", "unit": "um"},
]
ORDERS = {"registers": ODD, "word_order": "little", "byte_order": "little"}


@pytest.mark.parametrize("rig", [ORDERS], indirect=True)
async def test_signs_units_and_orders_come_back_as_they_went_in(rig: Rig) -> None:
    rows = await rig.rows(5)
    for torque, angle in zip(rows.channels[TORQUE], rows.channels[ANGLE], strict=True):
        number = round((torque - 0.25) / 0.001)
        assert torque == pytest.approx(0.25 + 0.001 * number, abs=1e-5)
        assert angle / 0.5 == pytest.approx(round(angle / 0.5), abs=1e-6)
