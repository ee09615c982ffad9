"""Modbus at its limits: polls per second, many devices in one process, one that hangs."""

import asyncio
import socket
import struct
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import aclosing, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base import Driver, DriverContext, DriverUnavailableError, load_driver
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import Floats
from edge_service.nodes.acquire_node import BACKOFF_CAP_S, BACKOFF_FIRST_S

from ..speed.process_meter import Program
from ..table import BenchError, Figure

RESPONDER = Path(__file__).with_name("modbus_responder.py")
REGISTERS = 17
DEVICES, RATE_HZ = 32, 10.0
ADDED_JITTER_S = 5e-3
STALE_S = 2.0
_REQUEST = struct.Struct(">HHHBBHH")


@contextmanager
def responders(count: int) -> Iterator[tuple[Program, list[int]]]:
    """Devices that answer every read, in a process of their own, and their ports."""
    with Program(sys.executable, str(RESPONDER), str(count)) as devices:
        ports = [int(port) for port in devices.hear().split()]
        if len(ports) != count:
            raise BenchError("the devices of the bench did not start")
        yield devices, ports


def make_driver(port: int, period_s: float) -> Driver:
    """A driver that reads REGISTERS registers in one request."""
    driver = load_driver("modbus")
    words = ["torque_command_nm", "motor_angle_rad", "table_position_m", "temperature_c"]
    registers: list[dict[str, Any]] = [
        {"channel": name, "address": 4 * number, "type": "uint64"}
        for number, name in enumerate(words)
    ]
    registers += [{"heartbeat": True, "address": REGISTERS - 1, "type": "uint16"}]
    settings = {
        "url": f"modbus://127.0.0.1:{port}",
        "poll_groups": {"all": period_s},
        "registers": registers,
    }
    context = DriverContext("X", load_machine(DEFAULT_MACHINE))
    return driver(driver.config_model.model_validate(settings), context)


def poll_figures(seconds: float) -> list[Figure]:
    """Flat out against one device: the driver, and a bare client of struct and socket."""
    with responders(1) as (_, (port,)):
        bare_s, bare_cpu_s = _bare_polls(port, seconds)
        driver_s, driver_cpu_s = asyncio.run(_driver_polls(port, seconds))
    bare = "a bare client"
    return [
        Figure("Modbus driver, flat out: a poll", 1e6 * driver_s, "us", 1e6 * bare_s, bare),
        Figure("  its processor time", 1e6 * driver_cpu_s, "us", 1e6 * bare_cpu_s, bare),
    ]


def _bare_polls(port: int, seconds: float) -> tuple[float, float]:
    """Time and processor time per poll, s, of the least that a client can do."""
    size = 9 + 2 * REGISTERS
    values = struct.Struct(f">9x{REGISTERS}H")
    polls, cpu_s, start_s = 0, time.process_time(), time.perf_counter()
    with socket.create_connection(("127.0.0.1", port)) as link:
        while time.perf_counter() - start_s < seconds:
            link.sendall(_REQUEST.pack(polls % 65_536, 0, 6, 1, 3, 0, REGISTERS))
            values.unpack(link.recv(size, socket.MSG_WAITALL))
            polls += 1
    return (time.perf_counter() - start_s) / polls, (time.process_time() - cpu_s) / polls


async def _driver_polls(port: int, seconds: float) -> tuple[float, float]:
    driver = make_driver(port, 1e-4)
    await driver.open()
    try:
        async with aclosing(driver.frames()) as frames:
            await anext(frames)
            begun, cpu_s = driver.counters["polls"], time.process_time()
            start_s = time.perf_counter()
            async for _ in frames:
                if time.perf_counter() - start_s >= seconds:
                    break
            polls = driver.counters["polls"] - begun
            elapsed_s = time.perf_counter() - start_s
            return elapsed_s / polls, (time.process_time() - cpu_s) / polls
    finally:
        await driver.close()


@dataclass(slots=True)
class _Axis:
    """Record of one reader: times of its rows, and when its device was lost."""

    times_s: list[float] = field(default_factory=list)
    lost_s: list[float] = field(default_factory=list)

    def late_s(self, from_s: float, to_s: float) -> Floats:
        """Deviations of the time steps within a window from the period, s."""
        times = np.array([each for each in self.times_s if from_s <= each < to_s])
        return np.abs(np.diff(times) - 1.0 / RATE_HZ)


def fleet_figures(window_s: float, hang_s: float) -> list[Figure]:
    """Many devices in one process, before and while one of them hangs."""
    with responders(DEVICES) as (devices, ports):
        return asyncio.run(_watch_fleet(devices, ports, window_s, hang_s))


async def _watch_fleet(
    devices: Program, ports: list[int], window_s: float, hang_s: float
) -> list[Figure]:
    async with _reading(ports) as axes:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(2.0)
        start_s, cpu_s = loop.time(), time.process_time()
        await asyncio.sleep(window_s)
        hung_s, cpu_s = loop.time(), time.process_time() - cpu_s
        devices.tell("hang 0")
        await asyncio.sleep(hang_s)
        end_s = loop.time()
        devices.tell("answer 0")
        await asyncio.sleep(BACKOFF_CAP_S + 2.0)
    hanging, others = axes[0], axes[1:]
    before, during = (
        float(np.percentile(np.concatenate([axis.late_s(*span) for axis in others]), 99.0))
        for span in ((start_s, hung_s), (hung_s, end_s))
    )
    rows = sum(sum(start_s <= t < hung_s for t in axis.times_s) for axis in axes)
    lost = [each for each in hanging.lost_s if each >= hung_s]
    back = [each for each in hanging.times_s if each >= end_s]
    lost_s, back_s = (e[0] - t if e else float("inf") for e, t in ((lost, hung_s), (back, end_s)))
    added, name = (
        f"  added while one hangs for {hang_s:g} s",
        f"{DEVICES} devices at {RATE_HZ:g} Hz",
    )
    return [
        Figure(f"{name}: polls", rows / (hung_s - start_s), "polls/s"),
        Figure("  processor", cpu_s / (hung_s - start_s), "cores"),
        Figure("  jitter of a row, 99th percentile", before, "s"),
        Figure(added, max(during - before, 0.0), "s", at_most=ADDED_JITTER_S),
        Figure("  the hanging device is called lost after", lost_s, "s", at_most=STALE_S),
        Figure("  it is back after it answers again", back_s, "s", at_most=BACKOFF_CAP_S + 1.0),
    ]


@asynccontextmanager
async def _reading(ports: list[int]) -> AsyncIterator[list[_Axis]]:
    """Read every device until the end, trying again as the service does."""
    axes = [_Axis() for _ in ports]
    tasks = [asyncio.create_task(_read(port, axis)) for port, axis in zip(ports, axes, strict=True)]
    try:
        yield axes
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _read(port: int, axis: _Axis) -> None:
    driver, pause_s = make_driver(port, 1.0 / RATE_HZ), BACKOFF_FIRST_S
    loop = asyncio.get_running_loop()
    try:
        while True:
            try:
                await driver.open()
                async with aclosing(driver.frames()) as frames:
                    async for frame in frames:
                        pause_s = BACKOFF_FIRST_S
                        known = ~np.isnan(frame.channels["torque_command_nm"])
                        axis.times_s += frame.time_s[known].tolist()
            except DriverUnavailableError:
                axis.lost_s.append(loop.time())
                await asyncio.sleep(pause_s)
                pause_s = min(2.0 * pause_s, BACKOFF_CAP_S)
    finally:
        await driver.close()
