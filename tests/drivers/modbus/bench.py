"""A Modbus device over a real socket on the loopback interface."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from drivers.modbus.config import ModbusConfig
from drivers.modbus.driver import ModbusDriver
from drivers.modbus.stub import ModbusStub
from drivers.stub import Fault, FaultKind, StubAxis

from ..bench import CONTEXT, DriverBench, counting_source, free_port

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
        "port": port,
        "timeout_s": 0.2,
        "lost_after_s": 0.3,
        "poll_groups": {"fast": 0.01},
        "registers": REGISTERS,
        "frame_s": 0.02,
    }
    return ModbusConfig.model_validate(settings | changes)


def stub_of(config: ModbusConfig) -> ModbusStub:
    return ModbusStub([StubAxis("X", config, CONTEXT, counting_source())])


@asynccontextmanager
async def bench(_folder: Path) -> AsyncIterator[DriverBench]:
    config = config_of(free_port())
    stub = stub_of(config)
    await stub.start()
    stubs = [stub]

    async def lose() -> None:
        await stubs.pop().close()

    async def bring_back() -> None:
        stubs.append(stub_of(config))
        await stubs[-1].start()

    async def spoil() -> None:
        stubs[-1].fault = Fault(FaultKind.WORD_ORDER)

    async def heal() -> None:
        stubs[-1].fault = Fault()

    try:
        yield DriverBench(lambda: ModbusDriver(config, CONTEXT), lose, bring_back, spoil, heal)
    finally:
        for each in stubs:
            await each.close()
