"""One server for the module: its address space takes a second to build."""

from collections.abc import AsyncIterator

import pytest_asyncio

from drivers.opcua.stub import OpcuaStub
from drivers.opcua.variables import OpcuaConfig
from drivers.stub import Fault

from ..bench import free_port
from .bench import config_of, stub_of


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def served() -> AsyncIterator[tuple[OpcuaStub, OpcuaConfig]]:
    config = config_of(free_port())
    stub = stub_of(config)
    await stub.start()
    yield stub, config
    await stub.close()


@pytest_asyncio.fixture(loop_scope="module")
async def stub(served: tuple[OpcuaStub, OpcuaConfig]) -> AsyncIterator[OpcuaStub]:
    yield served[0]
    served[0].fault = Fault()


@pytest_asyncio.fixture(loop_scope="module")
async def config(served: tuple[OpcuaStub, OpcuaConfig]) -> OpcuaConfig:
    return served[1]
