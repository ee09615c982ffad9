"""A Modbus device in the whole service: it hangs, its axis goes stale in time, others go on."""

import asyncio

from drivers.stub import Fault, FaultKind
from edge_service.messages.features import Fault as Flaw
from edge_service.messages.health import ComponentStatus

from ...nodes.conftest import config_of as service_config
from ...nodes.conftest import running
from ..bench import free_port
from ..heard import Heard
from .bench import config_of, stub_of


async def test_the_axis_of_a_hanging_device_goes_stale_in_time_and_comes_back() -> None:
    device = config_of(free_port(), timeout_s=0.5, poll_groups={"all": 0.02})
    stub = stub_of(device)
    await stub.start()
    config = service_config("modbus", device.model_dump(exclude_none=True, mode="json"))
    async with running(config, ("acquire", "downsample")) as service:
        heard = Heard(service.bus, config.keys)
        try:
            async with asyncio.timeout(60.0):
                await heard.more(5)
            count = len(heard.features)
            stub.fault = Fault(FaultKind.HANG)
            async with asyncio.timeout(20.0):
                await heard.status(ComponentStatus.RECOVERABLE_ERROR)
                while heard.features[-1].usable:
                    await asyncio.sleep(0.02)
            stub.fault = Fault()
            async with asyncio.timeout(30.0):
                await heard.status(ComponentStatus.OK)
                await heard.more(5)
            assert any(Flaw.GAP in block.fault for block in heard.features[count:])
        finally:
            heard.close()
    await stub.close()
