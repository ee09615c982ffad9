"""A stub server: the simulated drive, or a recording, behind a real protocol."""

import asyncio
import logging
import signal
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drivers.base import DriverContext, DriverMisconfiguredError, DriverUnavailableError
from drivers.registry import load_driver
from drivers.stub import Fault, Stub, StubAxis, load_stub, stub_names

from ..config import AxisConfig, ConfigError, EdgeConfig, check_settings, load_machine
from ..messages.samples import SampleFrame

log = logging.getLogger(__name__)
FRAME_S = 0.005
"""Axis time between two values of a stub: fresher than the fastest poll can see."""


async def run_stub(
    name: str,
    config: EdgeConfig,
    axis: str | None,
    scenario: str,
    fault: Fault,
    announce: Callable[[str], None],
    recording: Path | None = None,
    port: int | None = None,
) -> None:
    """Serve the configuration's axes of that driver until SIGINT or SIGTERM.

    Args:
        recording: is played once, in place of the simulated drive.
        port: in place of the configuration's.

    Raises:
        ConfigError: no such axis, wrong settings, or an address that cannot be taken.
    """
    stub = make_stub(name, config, axis, scenario, recording, port)
    stub.fault = fault
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(NotImplementedError, RuntimeError):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
    try:
        announce(await stub.start())
        await stop.wait()
    except DriverMisconfiguredError as error:
        raise ConfigError(f"stub {name}: {error} (--port takes another port)") from None
    finally:
        await stub.close()


def make_stub(
    name: str,
    config: EdgeConfig,
    axis: str | None,
    scenario: str,
    recording: Path | None = None,
    port: int | None = None,
) -> Stub:
    """The stub of the axes that use the driver `name`. Raises ConfigError."""
    if name not in stub_names():
        raise ConfigError(f"no stub {name!r}; there are {', '.join(stub_names())}")
    chosen = [each for each in config.axes if each.driver == name and axis in (None, each.name)]
    if not chosen:
        wanted = f"axis {axis!r}" if axis else "axis"
        raise ConfigError(f"axes: the configuration has no {wanted} with driver = {name!r}")
    if recording is not None and not recording.is_file():
        raise ConfigError(f"--trace {recording}: no such file")
    try:
        axes = [_stub_axis(each, scenario, recording, port) for each in chosen]
        return load_stub(name)(axes)
    except DriverMisconfiguredError as error:
        raise ConfigError(f"stub {name}: {error}") from None


def _stub_axis(
    axis: AxisConfig, scenario: str, recording: Path | None, port: int | None
) -> StubAxis:
    given = axis.settings if port is None else _on_port(axis.settings, port)
    model = load_driver(axis.driver).config_model
    settings = check_settings(model, given, f"axes.{axis.name}.settings")
    context = DriverContext(axis.name, load_machine(axis.machine))
    played = recording is not None
    given = {"path": recording} if played else {"scenario": scenario}
    source = _driven("replay" if played else "simulated", given, context)
    return StubAxis(axis.name, settings, context, source)


def _on_port(settings: dict[str, Any], port: int) -> dict[str, Any]:
    """Settings of a driver with another port, which stands in its address or beside it."""
    if "url" not in settings:
        return settings | {"port": port}
    parts = urlsplit(str(settings["url"]))
    return settings | {"url": f"{parts.scheme}://{parts.hostname}:{port}{parts.path}"}


async def _driven(
    name: str, settings: dict[str, Any], context: DriverContext
) -> AsyncGenerator[SampleFrame, None]:
    """Samples of another driver, until it has no more."""
    kind = load_driver(name)
    driver: Any = kind(kind.config_model.model_validate(settings), context)
    driver.frame_s = FRAME_S
    try:
        await driver.open()
        async for frame in driver.frames():
            yield frame
    except (DriverMisconfiguredError, DriverUnavailableError) as error:
        log.error("axis %s: no samples: %s", context.axis, error)
    finally:
        await driver.close()
