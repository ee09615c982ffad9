"""An address space that follows the Machine Tool companion specification."""

from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
import pytest_asyncio
from asyncua.client.client import Client

from drivers.base import DriverMisconfiguredError
from drivers.opcua.driver import OpcuaDriver
from drivers.opcua.variables import OpcuaConfig
from edge_service.messages.channels import ANGLE, TEMPERATURE, TORQUE

from ..bench import CONTEXT, ROOT, free_port
from .bench import config_of, stub_of

NODESETS = ROOT.parent / "shared" / "data" / "opcua_nodesets"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"
OWN = "urn:edge-service:feed-drive"
AXIS = f"{{{MACHINERY}}}Machines/{{{OWN}}}Lathe/{{{MACHINE_TOOL}}}Monitoring/{{{OWN}}}X"

pytestmark = [
    pytest.mark.asyncio(loop_scope="module"),
    pytest.mark.slow,
    pytest.mark.skipif(not NODESETS.is_dir(), reason="the companion nodesets are not here"),
]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def config() -> AsyncIterator[OpcuaConfig]:
    signals = [
        {"channel": TORQUE, "node": f"{AXIS}/{{{OWN}}}Torque"},
        {"channel": ANGLE, "node": f"{AXIS}/{{{OWN}}}Angle", "unit": "deg"},
        {"channel": TEMPERATURE, "node": f"{AXIS}/{{{OWN}}}Temperature"},
    ]
    made = config_of(free_port(), signals=signals)
    stub = stub_of(made, NODESETS)
    await stub.start()
    yield made
    await stub.close()


async def test_an_axis_is_read_from_a_machine_tool(config: OpcuaConfig) -> None:
    driver = OpcuaDriver(config, CONTEXT)
    await driver.open()
    frames = driver.frames()
    frame = await anext(frames)
    assert np.isfinite(frame.channels[TORQUE]).all()
    np.testing.assert_allclose(frame.channels[TEMPERATURE], 21.5)
    half_turns = frame.channels[ANGLE] / 0.5
    np.testing.assert_allclose(half_turns, np.round(half_turns), atol=1e-9)
    await frames.aclose()
    await driver.close()


async def test_the_machine_is_of_the_type_of_the_specification(config: OpcuaConfig) -> None:
    async with Client(config.url, timeout=4.0) as client:
        namespaces = await client.get_namespace_array()
        machinery, tool, own = (namespaces.index(uri) for uri in (MACHINERY, MACHINE_TOOL, OWN))
        lathe = await client.nodes.objects.get_child([f"{machinery}:Machines", f"{own}:Lathe"])
        kind = client.get_node(await lathe.read_type_definition())
        assert (await kind.read_browse_name()).Name == "MachineToolType"
        children = {(await child.read_browse_name()).Name for child in await lathe.get_children()}
        assert {"Identification", "Monitoring", "Production", "Notification"} <= children
        monitoring = await lathe.get_child(f"{tool}:Monitoring")
        names = {(await each.read_browse_name()).Name for each in await monitoring.get_children()}
        assert "X" in names


async def test_a_folder_without_the_specification_names_it(tmp_path: Path) -> None:
    stub = stub_of(config_of(free_port()), tmp_path)
    with pytest.raises(DriverMisconfiguredError, match=r"nodesets: .*Di\.NodeSet2\.xml"):
        await stub.start()
    await stub.close()
