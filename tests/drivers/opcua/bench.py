"""An OPC UA server over a real socket on the loopback interface."""

from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

from drivers.opcua.driver import OpcuaDriver
from drivers.opcua.stub import OpcuaStub
from drivers.opcua.variables import OpcuaConfig
from drivers.stub import FaultKind, StubAxis

from ..bench import CONTEXT, DriverBench, counting_source, free_port, stub_bench

SIGNALS = [
    {"channel": "torque_command_nm", "node": "ns=2;s=X.torque"},
    {"channel": "motor_angle_rad", "node": "nsu=urn:edge-service:feed-drive;s=X.angle"},
    {"channel": "table_position_m", "node": "ns=2;s=X.position", "unit": "mm"},
    {"channel": "temperature_c", "node": "nsu=urn:other;i=5"},
    {"heartbeat": True, "node": "ns=2;i=77"},
]


def config_of(port: int, **changes: Any) -> OpcuaConfig:
    settings = {
        "url": f"opc.tcp://127.0.0.1:{port}",
        "signals": SIGNALS,
    }
    return OpcuaConfig.model_validate(settings | changes)


def stub_of(config: OpcuaConfig) -> OpcuaStub:
    return OpcuaStub([StubAxis("X", config, CONTEXT, counting_source())])


def bench(_folder: Path) -> AbstractAsyncContextManager[DriverBench]:
    config = config_of(free_port())
    return stub_bench(
        lambda: stub_of(config), lambda: OpcuaDriver(config, CONTEXT), FaultKind.EXCEPTION
    )
