"""Against devices and masters that nobody here wrote: libmodbus, in C."""

import asyncio
import shutil
from collections.abc import AsyncIterator
from contextlib import aclosing
from pathlib import Path

import numpy as np
import pytest

from drivers.modbus.driver import ModbusDriver
from edge_service.messages.samples import ANGLE, TEMPERATURE, TORQUE, Quality
from tests.programs import ran

from ..bench import CONTEXT, free_port
from .bench import config_of

HERE = Path(__file__).parent


def compiled(name: str, folder: Path) -> Path:
    """A program of this folder, compiled against libmodbus; skips where that is not installed."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = folder / name
    line = (compiler, "-I/usr/include/modbus", HERE / f"{name}.c", "-o", program, "-lmodbus")
    built = ran(*line)
    if "modbus.h" in built.stderr or "-lmodbus" in built.stderr:
        pytest.skip("libmodbus is not installed (apt-get install libmodbus-dev)")
    assert built.returncode == 0, built.stderr
    return program


@pytest.fixture(scope="module")
def server_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("peer_server", tmp_path_factory.mktemp("libmodbus"))


class Device:
    def __init__(self, program: Path) -> None:
        self.port = free_port()
        self._program = program
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            self._program, str(self.port), stdout=asyncio.subprocess.PIPE
        )
        assert self._process.stdout is not None
        async with asyncio.timeout(60.0):
            assert await self._process.stdout.readline() == b"listening\n"

    async def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            await self._process.communicate()
            self._process = None


@pytest.fixture
async def device(server_program: Path) -> AsyncIterator[Device]:
    made = Device(server_program)
    await made.start()
    yield made
    await made.stop()


REGISTERS = [
    {"channel": TORQUE, "address": 0},
    {"channel": ANGLE, "address": 2, "word_order": "little"},
    {"heartbeat": True, "address": 4, "type": "uint16"},
    {"channel": TEMPERATURE, "address": 0, "table": "input", "type": "int32", "scale": 0.001},
]


async def test_values_of_a_foreign_device(device: Device) -> None:
    driver = ModbusDriver(config_of(device.port, registers=REGISTERS), CONTEXT)
    await driver.open()
    async with aclosing(driver.frames()) as frames:
        for _ in range(20):
            frame = await anext(frames)
            assert (frame.channels[TORQUE] == 0.25).all()
            assert (frame.channels[ANGLE] == -1.5).all()
            assert (frame.channels[TEMPERATURE] == -100.0).all()
            for codes in frame.quality.values():
                assert np.isin(codes, (Quality.GOOD, Quality.LATE_READ)).all(), frame.quality
    await driver.close()
