"""An OPC UA server over a real socket on the loopback interface."""

import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from drivers.opcua.driver import OpcuaDriver
from drivers.opcua.stub import OpcuaStub
from drivers.opcua.variables import OpcuaConfig
from drivers.stub import FaultKind, StubAxis

from ..bench import CONTEXT, DriverBench, counting_source, free_port, stub_bench

SIGNALS = [
    {"channel": "torque_command_nm", "node": "ns=2;s=X.torque"},
    {"channel": "motor_angle_rad", "node": "nsu=urn:edge-service:feed-drive;s=X.angle"},
    {"channel": "table_position_m", "node": "ns=2;s=X.position", "unit": "mm"},
    {"channel": "temperature_c", "node": "nsu=urn:other;i=5", "index": 2},
    {"heartbeat": True, "node": "ns=2;i=77"},
]


def config_of(port: int, **changes: Any) -> OpcuaConfig:
    settings = {"url": f"opc.tcp://127.0.0.1:{port}", "signals": SIGNALS}
    return OpcuaConfig.model_validate(settings | changes)


def stub_of(config: OpcuaConfig) -> OpcuaStub:
    return OpcuaStub([StubAxis("X", config, CONTEXT, counting_source())])


@asynccontextmanager
async def bench(_folder: Path) -> AsyncIterator[DriverBench]:
    config, ahead = config_of(free_port()), [0.0]
    clock = SimpleNamespace(time=lambda: time.time() + sum(ahead))
    made = stub_bench(
        lambda: stub_of(config), lambda: OpcuaDriver(config, CONTEXT), FaultKind.EXCEPTION
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("drivers.opcua.stub.time", clock)
        async with made as built:
            yield replace(built, step=ahead.append)
