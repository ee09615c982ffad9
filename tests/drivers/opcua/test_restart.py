"""A server that restarts: back within ten seconds, and the gap is marked."""

import asyncio

import pytest

from edge_service.messages.features import Fault
from edge_service.messages.health import ComponentStatus

from ...nodes.conftest import config_of as service_config
from ...nodes.conftest import running
from ..bench import free_port
from ..heard import Heard
from .bench import config_of, stub_of

BACK_WITHIN_S = 10.0


@pytest.mark.slow
async def test_after_a_restart_of_the_server_the_axis_is_back_and_the_gap_is_marked() -> None:
    driver_config = config_of(free_port())
    stub = stub_of(driver_config)
    await stub.start()
    settings = driver_config.model_dump(exclude_none=True, mode="json")
    config = service_config("opcua", settings)
    async with running(config, ("acquire", "downsample")) as service:
        heard = Heard(service.bus, config.keys)
        try:
            async with asyncio.timeout(20.0):
                await heard.more(10)
            await stub.close()
            async with asyncio.timeout(10.0):
                while ComponentStatus.RECOVERABLE_ERROR not in heard.statuses:
                    await asyncio.sleep(0.02)
            stub = stub_of(driver_config)
            await stub.start()
            before = len(heard.features)
            async with asyncio.timeout(BACK_WITHIN_S):
                await heard.more(5)
            assert any(Fault.GAP in block.fault for block in heard.features[before - 1 :])
            assert heard.statuses[-1] is ComponentStatus.OK
        finally:
            heard.close()
    await stub.close()
