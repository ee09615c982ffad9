"""A Modbus device that serves axes by the register map of the driver's own configuration."""

import asyncio
import logging
from collections.abc import Sequence
from functools import partial

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from ..base import DriverMisconfiguredError
from ..signals import scalings
from ..stub import Fault, FaultKind, Following, StubAxis
from .registers import REGISTERS, ModbusConfig, Order, Table, encode_number

logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
_OPPOSITE: dict[Order, Order] = {"big": "little", "little": "big"}


class ModbusStub:
    """A server for all axes that share its address; every read gets the latest sample.

    A constant is served as it is configured, a heartbeat counts the samples, and a channel that
    the axis does not have is NaN (0 in integers).
    """

    def __init__(self, axes: Sequence[StubAxis]) -> None:
        self.fault = Fault()
        self._axes = axes
        self._config: ModbusConfig = axes[0].config
        self._following = Following(axes, lambda config: config.endpoint[:2])
        self._server: ModbusTcpServer | None = None
        self._released = asyncio.Event()
        self._scalings = {
            axis.name: scalings(axis.config.registers, axis.context.machine, "registers")
            for axis in axes
        }

    async def start(self) -> str:
        await self._following.start()
        units = sorted({axis.config.endpoint[2] for axis in self._axes})
        host, port, _ = self._config.endpoint
        server = ModbusTcpServer([self._device(unit) for unit in units], address=(host, port))
        if not await server.listen():
            await self._following.close()
            raise DriverMisconfiguredError("url", f"{host}:{port} is in use or not ours")
        self._server = server
        return f"{host}:{port}"

    async def close(self) -> None:
        self._released.set()
        await self._following.close()
        server, self._server = self._server, None
        if server is not None:
            await server.shutdown()

    def _device(self, unit: int) -> SimDevice:
        """One memory for all tables, for clients to read; each read brings it up to date."""
        axes = [axis for axis in self._axes if axis.config.endpoint[2] == unit]
        memory = SimData(0, count=REGISTERS, datatype=DataType.REGISTERS, readonly=True)
        return SimDevice(unit, simdata=memory, action=partial(self._serve, axes))

    async def _serve(
        self,
        axes: Sequence[StubAxis],
        function: int,
        start: int,
        _address: int,
        _count: int,
        registers: list[int],
        _written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Callback of the library before a reply: bring the registers up to date, or misbehave."""
        fault = self.fault
        match fault.kind:
            case FaultKind.DELAY:
                await asyncio.sleep(fault.amount)
            case FaultKind.HANG:
                await self._released.wait()
            case FaultKind.EXCEPTION:
                return ExcCodes(int(fault.amount))
            case FaultKind.DROP if self._server is not None:
                for connection in list(self._server.active_connections.values()):
                    connection.close()
        if fault.kind is not FaultKind.STALE:
            for axis in axes:
                self._write(axis, "input" if function == 4 else "holding", start, registers)
        return None

    def _write(self, axis: StubAxis, table: Table, start: int, registers: list[int]) -> None:
        config: ModbusConfig = axis.config
        for register in config.registers:
            if register.table == table:
                word_order = register.word_order or config.word_order
                if self.fault.kind is FaultKind.WORD_ORDER:
                    word_order = _OPPOSITE[word_order]
                channel = register.channel or ""
                scaling = self._scalings[axis.name].get(channel)
                latest = axis.latest.get(channel)
                if scaling is None:
                    value = axis.samples % 30_000 if register.equals is None else register.equals
                elif latest is not None:
                    value = scaling.raw(latest)
                else:
                    value = float("nan") if register.type.startswith("float") else 0.0
                words = encode_number(value, register.type, word_order, config.byte_order)
                first = register.address - start
                registers[first : first + len(words)] = words
