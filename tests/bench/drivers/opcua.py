"""OPC UA notifications: all sessions of a stub that publishes as a SINUMERIK does."""

import asyncio
import time
from contextlib import aclosing
from pathlib import Path

from drivers.base import Driver, DriverContext, DriverUnavailableError, load_driver
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import CHANNELS

from ..speed.process_meter import PATIENCE_S, ServiceProcess
from ..table import BenchError, Figure

SESSIONS = 8  # of the ten that the stub has
_URL = "opc.tcp://127.0.0.1:{port}"
_AXIS = """[[axes]]
name = "A{number}"
driver = "opcua"
[axes.settings]
url = "{url}"
signals = [{signals}]
"""


def opcua_figures(folder: Path, kernels: Path, port: int, window_s: float) -> list[Figure]:
    """Notifications per second over all sessions, and what one costs."""
    url, config = _URL.format(port=port), folder / "opcua.toml"
    config.write_text("".join(_axis(number, url) for number in range(SESSIONS)))
    with ServiceProcess(["stub", "opcua", str(config)], folder, kernels) as stub:
        return asyncio.run(_measure(stub, url, window_s))


def _signals(number: int) -> list[dict[str, str]]:
    return [{"channel": name, "node": f"ns=2;s=A{number}.{name}"} for name in CHANNELS]


def _axis(number: int, url: str) -> str:
    signals = ", ".join(
        f'{{ channel = "{each["channel"]}", node = "{each["node"]}" }}' for each in _signals(number)
    )
    return _AXIS.format(number=number, url=url, signals=signals)


async def _measure(stub: ServiceProcess, url: str, window_s: float) -> list[Figure]:
    kind = load_driver("opcua")
    context = DriverContext("X", load_machine(DEFAULT_MACHINE))
    drivers: list[Driver] = [
        kind(kind.config_model.model_validate({"url": url, "signals": _signals(number)}), context)
        for number in range(SESSIONS)
    ]
    await _wait_for(stub, drivers[0])
    tasks = [asyncio.create_task(_drain(driver)) for driver in drivers]
    try:
        await asyncio.sleep(2.0)
        before, cpu_s, start_s = _changes(drivers), time.process_time(), time.perf_counter()
        await asyncio.sleep(window_s)
        count = _changes(drivers) - before
        cpu_s, elapsed_s = time.process_time() - cpu_s, time.perf_counter() - start_s
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    if count == 0:
        raise BenchError("no notification came")
    name = f"OPC UA, {SESSIONS} sessions at 100 ms: notifications"
    return [
        Figure(name, count / elapsed_s, "1/s"),
        Figure("  processor per notification", cpu_s / count, "s"),
    ]


async def _wait_for(stub: ServiceProcess, driver: Driver) -> None:
    while True:
        try:
            await driver.open()
            await driver.close()
            return
        except DriverUnavailableError as error:
            if stub.since_start_s() > PATIENCE_S:
                raise BenchError(f"the stub does not answer: {error}") from None
            await asyncio.sleep(0.2)


async def _drain(driver: Driver) -> None:
    await driver.open()
    try:
        async with aclosing(driver.frames()) as frames:
            async for _ in frames:
                pass
    finally:
        await driver.close()


def _changes(drivers: list[Driver]) -> int:
    return sum(driver.counters["changes"] for driver in drivers)
