"""A server that comes back with other namespace indexes and node ids: names still lead to them."""

import asyncio
from contextlib import aclosing

import numpy as np
import pytest

from drivers.opcua.driver import OpcuaDriver
from edge_service.messages.channels import ANGLE, TORQUE

from ..bench import CONTEXT, free_port
from .bench import config_of, stub_of

AXIS = "urn:plant:axis"
SIGNALS = [
    {"channel": TORQUE, "node": f"{{{AXIS}}}Drive/{{{AXIS}}}Torque"},
    {"channel": ANGLE, "node": f"nsu={AXIS};s=X.angle"},
]
BEFORE_IT = [
    {"channel": "table_position_m", "node": "{urn:plant:new}Table/{urn:plant:new}Position"},
    {"channel": "temperature_c", "node": "nsu=urn:plant:newer;s=Heat"},
]


async def served_to(driver: OpcuaDriver, port: int, signals: list[dict[str, str]]) -> set[str]:
    """Node ids under which a server with these variables served the driver."""
    stub = stub_of(config_of(port, signals=signals))
    await stub.start()
    try:
        async with asyncio.timeout(20.0):
            await driver.open()
            async with aclosing(driver.frames()) as frames:
                frame = await anext(frames)
                while not np.isfinite(frame.channels[TORQUE]).any():
                    frame = await anext(frames)
        assert (frame.channels[TORQUE] >= 0.25).any()
        assert (frame.channels[TORQUE] <= 0.35).any()
        channels = {signal.channel: node for _, signal, _, node in stub._points}
        return {channels[name].nodeid.to_string() for name in (TORQUE, ANGLE)}
    finally:
        await stub.close()


@pytest.mark.slow
async def test_a_server_with_other_node_ids_is_read_on_by_its_names() -> None:
    port = free_port()
    driver = OpcuaDriver(config_of(port, signals=SIGNALS), CONTEXT)
    try:
        first = await served_to(driver, port, SIGNALS)
        second = await served_to(driver, port, [*BEFORE_IT, *SIGNALS])
        assert not first & second
        assert driver.counters["sessions"] == 2
    finally:
        await driver.close()
