"""A Modbus device over a real socket on the loopback interface."""

from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

from drivers.modbus.driver import ModbusDriver
from drivers.modbus.registers import ModbusConfig
from drivers.modbus.stub import ModbusStub
from drivers.stub import FaultKind, StubAxis

from ..bench import CONTEXT, DriverBench, counting_source, free_port, stub_bench

REGISTERS = [
    {"channel": "torque_command_nm", "address": 0, "type": "float32"},
    {"channel": "motor_angle_rad", "address": 2, "type": "float64"},
    {"channel": "table_position_m", "address": 6, "type": "int32", "unit": "mm", "scale": 1e-3},
    {"equals": 3.14159274, "address": 8, "type": "float32"},
    {"heartbeat": True, "address": 10, "type": "uint16"},
    {"channel": "temperature_c", "address": 5, "table": "input", "type": "int16", "scale": 0.01},
]


def config_of(port: int, **changes: Any) -> ModbusConfig:
    settings = {
        "url": f"modbus://127.0.0.1:{port}/{changes.pop('device_id', 1)}",
        "timeout_s": 0.2,
        "poll_groups": {"fast": 0.01},
        "registers": REGISTERS,
    }
    return ModbusConfig.model_validate(settings | changes)


def stub_of(config: ModbusConfig) -> ModbusStub:
    return ModbusStub([StubAxis("X", config, CONTEXT, counting_source())])


def bench(_folder: Path) -> AbstractAsyncContextManager[DriverBench]:
    config = config_of(free_port())
    return stub_bench(
        lambda: stub_of(config), lambda: ModbusDriver(config, CONTEXT), FaultKind.WORD_ORDER
    )
