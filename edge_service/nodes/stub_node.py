"""A stub server: the simulated drive behind a real protocol."""

import asyncio
import logging
import signal
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from pathlib import Path

from drivers.base import DriverContext, DriverMisconfiguredError, DriverUnavailableError
from drivers.registry import load_driver
from drivers.stub import Fault, Stub, StubAxis, load_stub, stub_names

from ..config import AxisConfig, ConfigError, EdgeConfig, check_settings, load_machine
from ..messages.samples import SampleFrame
from ..models.machine import Machine

log = logging.getLogger(__name__)
FRAME_S = 0.005
"""Axis time between two values of a stub: fresher than the fastest poll can see."""


async def run_stub(
    name: str,
    config: EdgeConfig,
    axis: str | None,
    scenario: str,
    nodesets: Path | None,
    fault: Fault,
    announce: Callable[[str], None],
) -> None:
    """Serve the configuration's axes of that driver until SIGINT or SIGTERM.

    Raises:
        ConfigError: no such axis, wrong settings, or an address that cannot be taken.
    """
    stub = make_stub(name, config, axis, scenario, nodesets)
    stub.fault = fault
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(NotImplementedError, RuntimeError):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
    try:
        announce(await stub.start())
        await stop.wait()
    except DriverMisconfiguredError as error:
        raise ConfigError(f"stub {name}: {error}") from None
    finally:
        await stub.close()


def make_stub(
    name: str, config: EdgeConfig, axis: str | None, scenario: str, nodesets: Path | None
) -> Stub:
    """The stub of the axes that use the driver `name`. Raises ConfigError."""
    if name not in stub_names():
        raise ConfigError(f"no stub {name!r}; there are {', '.join(stub_names())}")
    chosen = [each for each in config.axes if each.driver == name and axis in (None, each.name)]
    if not chosen:
        wanted = f"axis {axis!r}" if axis else "axis"
        raise ConfigError(f"axes: the configuration has no {wanted} with driver = {name!r}")
    try:
        return load_stub(name)([_stub_axis(each, scenario) for each in chosen], nodesets)
    except DriverMisconfiguredError as error:
        raise ConfigError(f"stub {name}: {error}") from None


def _stub_axis(axis: AxisConfig, scenario: str) -> StubAxis:
    settings = check_settings(
        load_driver(axis.driver).config_model, axis.settings, f"axes.{axis.name}.settings"
    )
    context = DriverContext(axis.name, load_machine(axis.machine))
    source = _simulated(axis.name, context.machine, scenario)
    return StubAxis(axis.name, settings, context, source)


async def _simulated(
    axis: str, machine: Machine, scenario: str
) -> AsyncGenerator[SampleFrame, None]:
    """Samples of the simulated drive, for ever."""
    simulated = load_driver("simulated")
    settings = simulated.config_model.model_validate({"scenario": scenario, "frame_s": FRAME_S})
    driver = simulated(settings, DriverContext(axis, machine))
    try:
        await driver.open()
        async for frame in driver.frames():
            yield frame
    except (DriverMisconfiguredError, DriverUnavailableError) as error:
        log.error("axis %s: no samples: %s", axis, error)
    finally:
        await driver.close()
