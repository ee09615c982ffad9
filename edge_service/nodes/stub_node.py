"""A stub server: the simulated drive, or a recording, behind a real protocol."""

import logging
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drivers.base import (
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    load_driver,
)
from drivers.stub import ENTRY_POINT_GROUP, Fault, Stub, StubAxis

from ..config import AxisConfig, ConfigError, EdgeConfig, check_settings, load_machine
from ..messages.samples import SampleFrame
from ..plugins import plugins
from .service import install_stop

log = logging.getLogger(__name__)
FRAME_S = 0.005
"""Axis time between two values of a stub: fresher than the fastest poll can see."""


async def run_stub(make: Callable[[], Stub], fault: Fault, announce: Callable[[str], None]) -> None:
    """Serve the axes of a stub until SIGINT or SIGTERM.

    Raises ConfigError: also of an address that cannot be taken.
    """
    stub = make()
    stub.fault = fault
    stop = install_stop()
    try:
        announce(await stub.start())
        await stop.wait()
    except DriverMisconfiguredError as error:
        raise ConfigError(f"the stub cannot listen: {error} (--port takes another port)") from None
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
    """The stub of the axes that use the driver `name`: simulated, or a recording.

    Raises ConfigError: no such axis, or wrong settings.
    """
    stubs = plugins(ENTRY_POINT_GROUP)
    if name not in stubs:
        raise ConfigError(f"no stub {name!r}; there are {', '.join(stubs)}")
    chosen = [each for each in config.axes if each.driver == name and axis in (None, each.name)]
    if not chosen:
        wanted = f"axis {axis!r}" if axis else "axis"
        raise ConfigError(f"axes: the configuration has no {wanted} with driver = {name!r}")
    if recording is not None and not recording.is_file():
        raise ConfigError(f"--trace {recording}: no such file")
    try:
        kind: type[Stub] = stubs[name].load()
        return kind([stub_axis(each, scenario, recording, port) for each in chosen])
    except (ImportError, DriverMisconfiguredError) as error:
        raise ConfigError(f"stub {name}: {error}") from None


def stub_axis(axis: AxisConfig, scenario: str, trace: Path | None, port: int | None) -> StubAxis:
    """An axis that a stub serves, with its samples. Raises ConfigError."""
    given = axis.settings
    if port is not None:
        parts = urlsplit(str(given["url"]))
        given = given | {"url": f"{parts.scheme}://{parts.hostname}:{port}{parts.path}"}
    model = load_driver(axis.driver).config_model
    settings = check_settings(model, given, f"axes.{axis.name}.settings")
    context = DriverContext(axis.name, load_machine(axis.machine))
    played = ("simulated", {"scenario": scenario})
    kind, source = played if trace is None else ("replay", {"path": trace})
    return StubAxis(axis.name, settings, context, driven(kind, source, context))


async def driven(
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
