"""A Modbus device in the whole service: it hangs, its axis goes stale in time, others go on."""

import asyncio
import time

import numpy as np
import pytest

from drivers.modbus.driver import ModbusDriver
from drivers.stub import Fault, FaultKind
from edge_service.messages.channels import TORQUE
from edge_service.messages.features import Fault as Flaw
from edge_service.messages.health import ComponentStatus

from ...nodes.conftest import config_of as service_config
from ...nodes.conftest import running
from ..bench import CONTEXT, free_port
from ..heard import Heard
from .bench import config_of, stub_of

STALE_WITHIN_S = 2.0


async def test_a_device_that_hangs_does_not_slow_another() -> None:
    configs = [config_of(free_port()) for _ in range(2)]
    stubs, drivers = [stub_of(c) for c in configs], [ModbusDriver(c, CONTEXT) for c in configs]
    for stub, driver in zip(stubs, drivers, strict=True):
        await stub.start()
        await driver.open()
    hanging, fine = (driver.frames() for driver in drivers)
    try:
        await anext(hanging)
        stubs[0].fault = Fault(FaultKind.HANG)
        reading = asyncio.ensure_future(anext(hanging))
        steps: list[float] = []
        async with asyncio.timeout(10.0):
            while not reading.done():
                frame = await anext(fine)
                assert np.isfinite(frame.channels[TORQUE]).all()
                steps += np.diff(frame.time_s).tolist()
        assert len(steps) > 5
        assert np.median(steps) == pytest.approx(0.01, abs=0.004)
        assert np.isnan(reading.result().channels[TORQUE]).any()
    finally:
        await hanging.aclose()
        await fine.aclose()
        for stub, driver in zip(stubs, drivers, strict=True):
            await driver.close()
            await stub.close()


async def test_the_axis_of_a_hanging_device_goes_stale_in_time_and_comes_back() -> None:
    device = config_of(free_port(), timeout_s=0.5, lost_after_s=1.5, poll_groups={"all": 0.02})
    stub = stub_of(device)
    await stub.start()
    config = service_config("modbus", device.model_dump(exclude_none=True, mode="json"))
    async with running(config, ("acquire", "downsample")) as service:
        heard = Heard(service.bus, config.keys)
        try:
            async with asyncio.timeout(20.0):
                await heard.more(5)
            count = len(heard.features)
            stub.fault = Fault(FaultKind.HANG)
            start_s = time.monotonic()
            async with asyncio.timeout(10.0):
                await heard.status(ComponentStatus.RECOVERABLE_ERROR)
            assert time.monotonic() - start_s < STALE_WITHIN_S + 0.5
            assert not heard.features[-1].usable
            stub.fault = Fault()
            async with asyncio.timeout(10.0):
                await heard.status(ComponentStatus.OK)
                await heard.more(5)
            assert any(Flaw.GAP in block.fault for block in heard.features[count:])
        finally:
            heard.close()
    await stub.close()
